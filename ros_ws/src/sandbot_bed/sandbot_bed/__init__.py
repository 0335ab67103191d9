"""The fluidised bed: pulse protocol and volume fraction with its uncertainty."""
