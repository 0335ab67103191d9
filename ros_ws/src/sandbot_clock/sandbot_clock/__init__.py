"""The leg clock signal: gait parameters to leg set-points.

gait              Gait and its presets; leg angles and rates at any time
phase_clock       PhaseClock: the same while ω and gait change, start and stop, without jumps in angle
schedule          instants start + n/rate without drift; missed ones are skipped and counted
nodes/            clock_node: /leg_setpoints, /clock/start, /clock/stop, /clock/home
clock_parameters  its parameters and its command line, without ROS
"""
