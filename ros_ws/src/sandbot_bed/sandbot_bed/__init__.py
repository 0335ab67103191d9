"""The fluidised bed: pulse protocol and volume fraction with its uncertainty.

volume_fraction  φ = M/(ρ A height) and σ_φ; grain density by displacement of water
protocol         PulseProtocol: the state machine, heights in, blower levels out; prepare() runs it in simulated time
hardware         BedHardware: the two calls a driver must offer
status           a Command as the figures of /bed/status
nodes/           bed_node: /bed/prepare, /bed/abort, /bed/blower, /bed/volume_fraction, /bed/status
bed_parameters   its parameters and its command line, without ROS
"""
