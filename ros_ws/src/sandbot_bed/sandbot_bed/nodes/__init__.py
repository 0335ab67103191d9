"""Air pulses that set the volume fraction of the bed, as a node."""
