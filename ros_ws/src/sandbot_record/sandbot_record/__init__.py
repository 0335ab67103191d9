"""MCAP bags in and out, and the trials table made from them."""
