"""What spoils film: light, lens, glints, what hangs before the camera, compression, frames that are lost or late."""

from dataclasses import dataclass

from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class Film:
    """The section ``film`` of world.yaml; nothing is spoilt by default. Motion blur: ``exposure_s`` in cameras.yaml."""

    defocus_px: float = parameter(
        0.0, unit="px", doc="width of a defocused lens's Gaussian blur (standard deviation)", low=0.0, high=20.0
    )
    uneven: float = parameter(0.0, doc="share of the light that is missing in the corners", low=0.0, high=1.0)
    flicker: float = parameter(0.0, doc="share by which the light rises and falls", low=0.0, high=1.0)
    flicker_hz: float = parameter(97.0, unit="Hz", doc="how often it does", low=0.1, high=10000.0)
    glints: int = parameter(0, doc="grains that flash as bright as a marker, in every frame others", low=0, high=1000)
    cable_px: float = parameter(0.0, unit="px", doc="width of a cable that hangs across the view", low=0.0, high=500.0)
    jpeg_quality: int = parameter(0, doc="quality at which frames were compressed; 0: they were not", low=0, high=100)
    dropped: float = parameter(0.0, doc="share of the frames that never come", low=0.0, high=0.95)
    doubled: float = parameter(0.0, doc="share of the frames that come twice", low=0.0, high=1.0)
    jitter_s: float = parameter(
        0.0, unit="s", doc="scatter of a frame's instant; both cameras have one trigger", low=0.0, high=1.0
    )
