"""What every room shares.

errors      InputError: one line that says which file, row or parameter is wrong and what would be right
cli         command lines that print that line and exit 2
suggest     "did you mean …?" for a misspelt name
terminal    colour and lines of 80 columns for a person
lazy        public names of a package that are imported when they are asked for
parameters  frozen dataclasses with unit, bounds and meaning: YAML checks and ROS descriptors derive from them
files       text, YAML, JSON and CSV in; out through a temporary name, so that nothing is ever half-written
config      where the project's own configuration files lie
data_frame  tables for pandas
robot       the robot in numbers (robot.yaml); legs: where its c-legs sit on their shafts
accuracy    how well a trial is measured (cameras.yaml)
crew        who does work that can be shared out: worker processes, or
  workers   processes that leave Ctrl-C to their parent and end with it
  cluster   the workers of a Dask cluster
process     which process a node is, whether it lives, real-time priority; neighbours: all nodes of this host
lease       the right to move legs or blow air, for a while; standstill: whether a loop was frozen
messages    numpy to standard ROS messages (no rclpy)
serialization  those messages to CDR bytes, without DDS
topics      names, types and QoS of every topic, once
node        parameters, diagnostics, start and stop of a node
  timer     what calls it back, by the time that passes
  command_node  who commands it
  window_node   that it sends no more than its readers take
"""
