"""Previews of effects: the error after switching one, whether that helps, and the order of the list of effects."""

import math
from collections.abc import Mapping, Sequence

from sandbot_model.report import text

Preview = tuple[float, float] | None
"""Error (in sample, out of sample) [m/s] with an effect switched; None: not fitted yet, NaN: the fit failed."""
MIN_IMPROVEMENT = 0.02
"""Smallest relative reduction of the error for an effect to count as helpful."""


def helps(preview: Preview, now_m_s: float) -> bool:
    """Whether switching lowers the error by at least ``MIN_IMPROVEMENT``; True while that is not known yet."""
    return preview is None or preview[0] < (1.0 - MIN_IMPROVEMENT) * now_m_s


def ordered(previews: Mapping[str, Preview], on: Sequence[str] = ()) -> list[str]:
    """The names, those switched on first, then by increasing error; in the given order until all errors are known."""
    if any(preview is None for preview in previews.values()):
        return list(previews)

    def rank(name: str) -> tuple[bool, float]:
        preview = previews[name]
        error = preview[0] if preview else math.nan
        return name not in on, error if math.isfinite(error) else math.inf

    return sorted(previews, key=rank)


def change_of(preview: Preview, switched_on: bool, now_m_s: float) -> str:
    """``1.32 → 0.47 cm/s``: the error of mean speed without and with an effect."""
    if preview is None:
        return "…"
    if not math.isfinite(preview[0]):
        return "no fit"
    without, with_it = (preview[0], now_m_s) if switched_on else (now_m_s, preview[0])
    return f"{text.centi(without)} → {text.cm_s(with_it)}"
