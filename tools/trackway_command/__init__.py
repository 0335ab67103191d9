"""The ``trackway`` command: its verbs forward to the executables of the workspace, which stay as they are.

verbs    what there is, in one line each, and what to look at afterwards
main     picks the verb, runs it, says what is next
doctor   whether this installation works: Python, wheels, ROS 2, a message's round trip, shared memory, cameras, disk
"""
