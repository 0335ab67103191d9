"""What all packages share.

errors      InputError: one line that says which file, row or parameter is wrong and what would be right
cli         command lines that print this line and exit with code 2
suggest     "did you mean …?" for a misspelt name
terminal    coloured output in lines of 80 columns
lazy        public names of a package, imported on first access
typed       types of arguments of the Python API, checked when it is called
parameters  frozen dataclasses with unit, bounds and meaning: YAML checks and ROS descriptors derive from them
files       reading text and JSON; atomic writing through a temporary file
yaml_text   YAML; separated: tables of text, by any separator
config      where the project's own configuration files are installed
compiled    numba's njit, with its cache where there is room for one
arrays      the kinds of array; data_frame: tables as pandas DataFrames
robot       the robot in numbers (robot.yaml); legs: how its c-legs are mounted on their shafts
accuracy    how well a trial is measured (cameras.yaml)
crew        parallel work: on worker processes, or
  workers   processes that leave Ctrl-C to their parent and end with it; renewed: again after one was killed
  cluster   on the workers of a Dask cluster
process     which process a node is, whether it is alive, real-time priority; neighbours: all nodes of this host;
            dead_ports: those of killed nodes, which a new one should not take
host_clock  the wall clock, and by how much it was set
shared_memory  whether the host has enough for its nodes
stop        an orderly end when a signal asks for it; interrupt: Ctrl-C where it can end a command cleanly
lease       the right to move legs or blow air for a limited time; standstill: requests older than a stop
health      names of the figures, and words, that nodes act on when other nodes say them on /diagnostics
messages    numpy to standard ROS messages (no rclpy)
serialization  those messages to CDR bytes, without DDS
topics      names, types and QoS of every topic, once
ros/        (the only room that imports rclpy)
  node      start, heartbeat and end of a node
  endpoints publishers and subscriptions; service: a request repeated until it is answered
  ros_parameters  its parameters; ros_health: its figures on /diagnostics
  timer     periodic callbacks on a monotonic clock
  command_node  who may command it
  window_node   flow control: it sends no more than its readers take
"""
