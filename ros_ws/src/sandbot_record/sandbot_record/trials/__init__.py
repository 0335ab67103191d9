"""The trials table: rows from bags, CSV in and out, pictures of a trial."""
