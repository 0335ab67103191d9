"""Which effects help the data at hand: the change of the error with one switched, and the order of a list of them."""

import math
from collections.abc import Mapping, Sequence

from sandbot_model.report import text

Preview = tuple[float, float] | None
"""Error (in sample, out of sample) [m/s] with an effect switched; None: not fitted yet, NaN: the fit failed."""
MIN_IMPROVEMENT = 0.02
"""Share of the error that an effect must take away to be said to help."""


def helps(preview: Preview, now_m_s: float) -> bool:
    """Whether switching lowers the error by a share worth a reader's time; also while that is not known yet."""
    return preview is None or preview[0] < (1.0 - MIN_IMPROVEMENT) * now_m_s


def ordered(previews: Mapping[str, Preview], on: Sequence[str] = ()) -> list[str]:
    """The names: those switched on, then by the error with each, the lowest first; as they came till all are known."""
    if any(preview is None for preview in previews.values()):
        return list(previews)

    def place(name: str) -> tuple[bool, float]:
        preview = previews[name]
        error = preview[0] if preview else math.nan
        return name not in on, error if math.isfinite(error) else math.inf

    return sorted(previews, key=place)


def change_of(preview: Preview, switched_on: bool, now_m_s: float) -> str:
    """``1.32 → 0.47 cm/s``: the error of mean speed before and after an effect is switched."""
    if preview is None:
        return "…"
    if not math.isfinite(preview[0]):
        return "no fit"
    without, with_it = (preview[0], now_m_s) if switched_on else (now_m_s, preview[0])
    return f"{text.centi(without)} → {text.cm_s(with_it)}"
