"""MCAP bags in and out; no ROS needed."""
