"""Thresholds of the test of lack of fit, by which fits state standard errors and verdicts reject models."""

LACK_OF_FIT = 5e-3
"""p-value of the joint test below which a model is rejected."""
GROSS = 3.0
"""Misfit of every cell mean, in standard errors, that the joint test must be able to detect."""
