"""The frame rate of a film: from the calibration, else from the film's own header.

A high-speed film often states the rate at which it is played, so cameras.yaml takes precedence; but as every speed is
proportional to the rate, a film that states another one is reported.
"""

from collections.abc import Mapping

from sandbot_common.errors import InputError
from sandbot_tracking.calibration import HIGH_HZ, LOW_HZ, Camera

TOLERANCE = 0.01
"""Relative difference up to which two rates agree: 29.97 is 30."""


def film_rate(cameras: Mapping[str, Camera], films_hz: Mapping[str, float]) -> tuple[float, str]:
    """Frames per second, and a note on their source unless calibration and all films agree.

    ``films_hz``: the rates stated by synchronous films, the dorsal one first. Raises InputError if no rate is known.
    """
    # A container without a rate gives 0, or the ticks of its clock.
    known = {film: hz for film, hz in films_hz.items() if LOW_HZ <= hz <= HIGH_HZ}
    calibrated = [camera.frame_rate_hz for camera in cameras.values() if camera.rate_is_known]
    if not (calibrated or known):
        raise InputError(f"{next(iter(films_hz))}: says no frame rate: give frame_rate_hz in cameras.yaml")
    rate_hz = calibrated[0] if calibrated else next(iter(known.values()))
    whose = "as calibrated" if calibrated else f"as {next(iter(known))} says, for the calibration gives no rate"
    others = [f"{film} says {hz:g}" for film, hz in known.items() if abs(hz / rate_hz - 1.0) > TOLERANCE]
    if calibrated and not others:
        return rate_hz, ""
    return rate_hz, ", but ".join((f"timed at {rate_hz:g} frames/s {whose}", *others))
