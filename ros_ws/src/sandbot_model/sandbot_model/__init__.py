"""Walking models on granular ground, effects, fit, compare, discover."""
