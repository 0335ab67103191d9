"""Nodes for robot legs and air valves on a serial line, and for cameras of a machine without ROS."""
