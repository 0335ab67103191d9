"""One model fitted to one set of cells, and how well it does."""
