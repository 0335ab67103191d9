"""Previews of effects: the error after switching one, whether that helps, and the order of the list of effects."""

import math
from collections.abc import Mapping, Sequence

from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.effect import Effect, is_from_catalogue
from sandbot_model.report import text

Preview = tuple[float, float] | None
"""Error of mean speed in sample [m/s] and BIC with an effect switched; None: not fitted yet, NaN: the fit failed."""


def helps(preview: Preview, now_bic: float) -> bool:
    """Whether switching lowers the BIC; True while that is not known yet."""
    return preview is None or preview[1] < now_bic


def folded(effect: Effect, preview: Preview, now: Fit) -> bool:
    """Whether an effect is folded away: one of the catalogue that is off and does not help the fit ``now``."""
    return effect.identifier not in now.effects and is_from_catalogue(effect) and not helps(preview, now.bic)


def ordered(previews: Mapping[str, Preview], on: Sequence[str] = ()) -> list[str]:
    """The names, those switched on first, then by increasing BIC; in the given order until all are known."""
    if any(preview is None for preview in previews.values()):
        return list(previews)

    def rank(name: str) -> tuple[bool, float]:
        preview = previews[name]
        bic = preview[1] if preview else math.nan
        return name not in on, bic if math.isfinite(bic) else math.inf

    return sorted(previews, key=rank)


def delta_bic(preview: Preview, switched_on: bool, now_bic: float) -> str:
    """``ΔBIC −123``: the change of the BIC from without an effect to with it; empty where it is not known."""
    if preview is None or not math.isfinite(preview[1]):
        return ""
    return f"ΔBIC {text.number((now_bic - preview[1]) * (1 if switched_on else -1), 0)}"


def change_of(preview: Preview, switched_on: bool, now_m_s: float) -> str:
    """``1.32 → 0.47 cm/s``: the error of mean speed without and with an effect."""
    if preview is None:
        return "…"
    if not math.isfinite(preview[0]):
        return "–" if math.isfinite(preview[1]) else "no fit"
    without, with_it = (preview[0], now_m_s) if switched_on else (now_m_s, preview[0])
    return f"{text.centi(without)} → {text.cm_s(with_it)}"
