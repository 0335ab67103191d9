"""What every room shares.

errors      InputError: one line that says which file, row or parameter is wrong and what would be right
cli         command lines that print that line and exit 2
lazy        public names of a package that are imported when they are asked for
parameters  frozen dataclasses with unit, bounds and meaning: YAML checks and ROS descriptors derive from them
terminal    colour and lines of 80 columns for a person
suggest     "did you mean …?" for a misspelt name
files       text, YAML, JSON and CSV in; out through a temporary name, so that nothing is ever half-written
workers     worker processes that leave Ctrl-C to their parent and end with it
crew        who does work that can be shared out: worker processes, or
cluster     the workers of a Dask cluster
messages    numpy to standard ROS messages (no rclpy)
serialization  those messages to CDR bytes, without DDS
topics      names, types and QoS of every topic, once
node        parameters, diagnostics, start and stop of a node
"""
