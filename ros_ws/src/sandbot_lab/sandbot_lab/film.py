"""Degradation of film: light, lens, glints, obstruction of the view, compression, lost or late frames."""

from dataclasses import dataclass

from sandbot_common.parameters import parameter


@dataclass(frozen=True)
class Film:
    """The section ``film`` of world.yaml; no degradation by default. Motion blur: ``exposure_s`` in cameras.yaml."""

    defocus_px: float = parameter(
        0.0, unit="px", doc="width of a defocused lens's Gaussian blur (standard deviation)", low=0.0, high=20.0
    )
    uneven: float = parameter(0.0, doc="fraction of the light that is missing in the corners", low=0.0, high=1.0)
    flicker: float = parameter(0.0, doc="relative amplitude of flicker of the light", low=0.0, high=1.0)
    flicker_hz: float = parameter(97.0, unit="Hz", doc="frequency of the flicker", low=0.1, high=10000.0)
    glints: int = parameter(0, doc="grains as bright as a marker, at new places in every frame", low=0, high=1000)
    cable_px: float = parameter(0.0, unit="px", doc="width of a cable that hangs across the view", low=0.0, high=500.0)
    jpeg_quality: int = parameter(0, doc="JPEG quality of the frames; 0: not compressed", low=0, high=100)
    dropped: float = parameter(0.0, doc="fraction of the frames that are lost", low=0.0, high=0.95)
    doubled: float = parameter(0.0, doc="fraction of the frames that are sent twice", low=0.0, high=1.0)
    jitter_s: float = parameter(
        0.0, unit="s", doc="scatter of a frame's instant; both cameras share a trigger", low=0.0, high=1.0
    )
