"""Nodes that write topics to bags, and play bags back."""
