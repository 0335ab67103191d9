"""The leg clock as a node."""
