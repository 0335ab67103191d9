"""Which effects are missing: comparison, search over the catalogue, verdict, next trials."""
