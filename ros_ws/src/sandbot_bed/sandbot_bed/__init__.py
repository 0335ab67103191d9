"""The fluidised bed: pulse protocol and volume fraction with its uncertainty.

volume_fraction  φ = M/(ρ A height) and σ_φ; grain density by displacement of water
protocol         PulseProtocol: the state machine, heights in, blower levels out; prepare() runs it in simulated time
hardware         BedHardware: the two calls a driver must offer
status           a Command as the figures of /bed/status
bed_node         the only module with ROS: /bed/prepare, /bed/abort, /bed/blower, /bed/volume_fraction, /bed/status
"""
