"""The frame rate of a film: from the calibration, else from the film's own header.

A high-speed film often states the rate at which it is played, so cameras.yaml takes precedence; but as every speed is
proportional to the rate, a film that states another one is reported. Frames that are missing, as its own stamps show,
leave a gap in time.
"""

from collections.abc import Mapping

from sandbot_common.errors import InputError
from sandbot_tracking.calibration import HIGH_HZ, LOW_HZ, Camera

TOLERANCE = 0.01
"""Relative difference up to which two rates agree: 29.97 is 30."""
RECENT, FEW = 50, 10
"""Frames whose stamps give the period of a film, a telephone's may vary; and the fewest that do."""
COARSEST_S = 1.001e-3
"""Stamps in whole milliseconds make a step wrong by this: among 1000 frames/s a single missing one is not seen."""


class FrameNumbers:
    """The number of each frame of a film by its own stamps: one is left out for each frame that is missing."""

    def __init__(self, rate_hz: float) -> None:
        """``rate_hz``: as the film states it; 0 if it does not."""
        self.numbers: list[int] = []
        self._stamps_s: list[float] = []
        self._stated_s = 1.0 / rate_hz if rate_hz > 0 else 0.0

    def add(self, stamp_s: float) -> int:
        """The number of the next frame. A stamp that does not grow, as in a container without any, says nothing."""
        step_s, period_s = stamp_s - self._stamps_s[-1] if self._stamps_s else 0.0, self._period_s
        more = round(step_s / period_s) if step_s > period_s + COARSEST_S and period_s > 0 else 1
        self.numbers.append(self.numbers[-1] + more if self.numbers else 0)
        self._stamps_s.append(stamp_s)
        return self.numbers[-1]

    @property
    def _period_s(self) -> float:
        """The mean over recent frames, as each stamp is rounded; at first as stated, 0 if it is not."""
        since = max(len(self.numbers) - RECENT, 0)
        count = self.numbers[-1] - self.numbers[since] if self.numbers else 0
        return (self._stamps_s[-1] - self._stamps_s[since]) / count if count >= FEW else self._stated_s

    @property
    def missing(self) -> int:
        """How many frames are missing so far."""
        return self.numbers[-1] + 1 - len(self.numbers) if self.numbers else 0

    @property
    def rate_hz(self) -> float:
        """Over the whole film, as each stamp may be rounded to a millisecond; 0 if unknown."""
        span_s = self._stamps_s[-1] - self._stamps_s[0] if self._stamps_s else 0.0
        return self.numbers[-1] / span_s if span_s > 0 else 0.0


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
