"""Nodes: a camera as frames on a topic, and frames as positions of the markers."""
