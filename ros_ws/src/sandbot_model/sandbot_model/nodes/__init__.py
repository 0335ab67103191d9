"""The model's prediction for the running trial, as a node."""
