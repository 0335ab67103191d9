"""A small stand-in for the ``ros2`` command where no full ROS 2 is installed (docs/decisions/0002-ros2-fallback.md).

main        picks the command; everything not covered is refused in one line
packages    run: where packages and their executables lie
processes   launch: several processes, one prefix each, stopped together
launching   launch: this workspace's node table as processes
bag         bag: the project's own record, replay and info
graph       a short-lived node and waiting for discovery; the only way into rclpy for the three below
topics      topic list, echo, hz, info, type
nodes       node list, info
parameters  param list, get, set, describe, dump
services    service list, type, call
convert     messages to YAML and CSV, YAML to messages
rate        the figures that topic hz prints
"""
