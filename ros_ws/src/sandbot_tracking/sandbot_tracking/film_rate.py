"""How fast a film was taken: by its calibration, or by its own word where that gives no frame rate.

A high-speed film often carries the rate at which it is shown, so what cameras.yaml says goes first; but as every speed
is in proportion to it, a film that says otherwise is named.
"""

from collections.abc import Mapping

from sandbot_common.errors import InputError
from sandbot_tracking.calibration import HIGH_HZ, LOW_HZ, Camera

AGREED = 0.01
"""Part by which two rates may differ and mean the same: 29.97 is 30."""


def film_rate(cameras: Mapping[str, Camera], films_hz: Mapping[str, float]) -> tuple[float, str]:
    """Frames per second, and whose word that is where it isn't everybody's.

    ``films_hz``: what films taken in step say, the dorsal one first. Raises InputError where nobody knows.
    """
    # A container that knows no rate says 0, or the ticks of its clock.
    known = {film: hz for film, hz in films_hz.items() if LOW_HZ <= hz <= HIGH_HZ}
    calibrated = [camera.frame_rate_hz for camera in cameras.values() if camera.rate_is_known]
    if not (calibrated or known):
        raise InputError(f"{next(iter(films_hz))}: says no frame rate: give frame_rate_hz in cameras.yaml")
    rate_hz = calibrated[0] if calibrated else next(iter(known.values()))
    whose = "as calibrated" if calibrated else f"as {next(iter(known))} says, for the calibration gives no rate"
    others = [f"{film} says {hz:g}" for film, hz in known.items() if abs(hz / rate_hz - 1.0) > AGREED]
    if calibrated and not others:
        return rate_hz, ""
    return rate_hz, ", but ".join((f"timed at {rate_hz:g} frames/s {whose}", *others))
