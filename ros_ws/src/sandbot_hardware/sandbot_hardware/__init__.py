"""A bed, a leg controller and cameras on serial lines: example drivers, and simulated devices to test them on.

lines               the wire format: lines with checksums, and blocks of bytes
device_clock        a device's time on the host's clock
port                a serial line that is reopened when its cable is back
devices             simulated controllers of legs and bed, each with its own watchdog
simulate            the devices, each on a pseudo_terminal, connected to the virtual lab's robot, bed and cameras
  films             the cameras, in a process of their own; simulate_command: the command line
nodes/
  serial_legs_node    /leg_setpoints out, /leg_states and /sync_led in
  serial_bed_node     /bed/blower out, /bed/height in
  serial_camera_node  frames of one camera in
"""
