"""What connects a core to ROS: a node's parameters, timers, commands and the watch over who sends them."""
