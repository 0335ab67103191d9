"""A bed, a leg controller and cameras on serial lines: an example of drivers, and devices to try them on.

lines               what goes over the wire: checked lines, and blocks of bytes
device_clock        a device's time on the host's clock
port                a serial line that is opened again when its cable is back
serial_legs_node    /leg_setpoints out, /leg_states and /sync_led in
serial_bed_node     /bed/blower out, /bed/height in
serial_camera_node  frames of one camera in
devices             simulated controllers of legs and bed, each with a watchdog of its own
simulate            the devices on pseudo-terminals, with the virtual lab's robot, bed and cameras behind them
"""
