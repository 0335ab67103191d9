"""Nodes: the live campaign (``live_node``, ``campaign_node`` and what it is made of) and what people see of it."""
