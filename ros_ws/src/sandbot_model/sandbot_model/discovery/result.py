"""What ``discover`` found: a verdict and what it rests on, as plain data and in words."""

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np

from sandbot_common.robot import to_mapping
from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.candidates import Candidate, only_implausible
from sandbot_model.discovery.criteria import DEFAULT, Criteria
from sandbot_model.discovery.ladder import ladder_rows
from sandbot_model.discovery.limits import Limit
from sandbot_model.discovery.next_trials import NextTrial
from sandbot_model.discovery.partial import Partial
from sandbot_model.discovery.residual import SuggestedFormula
from sandbot_model.discovery.unseen import Shift
from sandbot_model.discovery.verdict import Verdict, in_full
from sandbot_model.fitting.diagnose import StageTest
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.plain import data_summary, number, plain
from sandbot_model.fitting.text import WIDTH, html_table, table

SCHEMA = "sandbot.discovery/2"


@dataclass(frozen=True, eq=False, repr=False)
class Discovery:
    """Everything ``discover`` found. ``steps`` is the ladder: the base model, then one more effect at each step."""

    model: str
    cells: Cells
    noise_floor: Mapping[str, float]
    steps: tuple[Fit, ...]
    candidates: tuple[Candidate, ...]
    verdict: Verdict
    next_trials: tuple[NextTrial, ...]
    stability: float = float("nan")
    """Fraction of bootstrap draws in which the named set, or one of its alternatives, is best among the leading sets;
    NaN where the verdict does not name what is best of all sets."""
    unseen: tuple[str, ...] = ()
    """If the base model is adequate: effects that these data would not reveal at their usual strength."""
    unseen_shift: Shift | None = None
    """The largest shift of Δt that one of these would cause, if it exceeds two of its errors."""
    stages: tuple[StageTest, ...] = ()
    """Tests of each stage of the chain: where the base model fails."""
    residual: SuggestedFormula | None = None
    """If no set of the catalogue fits: a formula to try for the remaining misfit."""
    fits: tuple[Fit, ...] = ()
    """Every set that was fitted, in order of BIC."""
    partial: Partial | None = None
    """If one effect repairs most of the misfit: what fraction of it, where it holds and where it fails."""
    variants: Mapping[str, str] = field(default_factory=dict)
    """The convention of each named effect whose formula departs from the catalogue's."""
    limits: tuple[Limit, ...] = ()
    """Limits at 95 % on effects that are absent; empty as well if they were not asked for."""
    alike: tuple[Fit, ...] = ()
    """Sets with effects in another form than the catalogue's that do not fit clearly worse than the identified one."""
    allowing: str = ""
    """What the trials share, in words, without which an adequate base model would show lack of fit; else empty."""
    controls: Mapping[str, str] = field(default_factory=dict)
    """If no trial distinguishes the alternatives: the experiments by which their effects show (``Effect.control``)."""
    criteria: Criteria = DEFAULT
    """The thresholds of the verdict."""

    @property
    def noise_floor_m_s(self) -> float:
        """Scatter of replicates in the mean speed."""
        return self.noise_floor["speed"]

    @property
    def fit(self) -> Fit:
        """The last step of the ladder: the set that the verdict names, or the base model."""
        return self.steps[-1]

    @property
    def only_implausible(self) -> dict[str, str]:
        """Single effects that are not named, as they leave no lack of fit only with the values given, in words."""
        found = only_implausible(self.candidates, self.fits, self.criteria)
        return {name: values for name, values in found.items() if (name,) not in self.verdict.alternatives}

    def to_dict(self) -> dict[str, Any]:
        """Plain data of schema ``sandbot.discovery/2``; unknown numbers are None."""
        return {
            "schema": SCHEMA,
            "model": self.model,
            "robot": to_mapping(self.cells.robot),
            "data": data_summary(self.cells),
            "noise_floor_m_s": number(self.noise_floor_m_s),
            "noise_floor": {name: number(value) for name, value in self.noise_floor.items()},
            "steps": [step.to_dict() for step in self.steps],
            "candidates": plain(self.candidates),
            "verdict": {
                "status": self.verdict.status,
                "effects": list(self.verdict.effects),
                "alternatives": [list(names) for names in self.verdict.alternatives],
                "because": self.verdict.because,
            },
            "next_trials": plain(self.next_trials),
            "controls": dict(self.controls),
            "unseen": list(self.unseen),
            "unseen_shift": plain(self.unseen_shift),
            "stability": number(self.stability),
            "stages": plain(self.stages),
            "residual": plain(self.residual),
            "nuisances": self.fit.nuisances_to_dict(),
            "partial": plain(self.partial),
            "variants": dict(self.variants),
            "limits": plain(self.limits),
        }

    @property
    def headline(self) -> str:
        """The verdict in a few words: ``identified: stance_overlap``, ``ambiguous: one of 2 sets: a; b``."""
        sets = [in_full(names, self.variants) for names in self.verdict.alternatives]
        if self.verdict.status == "ambiguous":
            return f"ambiguous: one of {len(sets)} sets: {'; '.join(sets)}"
        named = " or ".join(sets)
        if self.allowing:
            return f"{self.verdict.status}, allowing for {self.allowing}"
        return f"{self.verdict.status}: {named}" if named else self.verdict.status

    @property
    def stability_in_words(self) -> str:
        """How often the named set, or one of the alternatives, is best; empty if none is named."""
        if not np.isfinite(self.stability):
            return ""
        which = "one of these is the" if self.verdict.status == "ambiguous" else ""
        return f"{which} best in {100 * self.stability:.0f} % of bootstrap draws".strip()

    def in_words(self, effect: str) -> str:
        """An effect, with its convention if that is not the catalogue's."""
        return f"{effect} ({self.variants[effect]})" if effect in self.variants else effect

    def __repr__(self) -> str:
        best = f" ({self.stability_in_words})" if self.stability_in_words else ""
        lines = [
            f"{self.headline}{best}",
            textwrap.fill(self.verdict.because, WIDTH),
            "",
            table(ladder_rows(self.steps)),
            "",
            repr(self.fit),
        ]
        if self.residual is not None:
            lines += ["", f"try: {self.residual.formula}"]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        head, because = escape(self.headline), escape(self.verdict.because)
        tables = html_table(ladder_rows(self.steps)) + self.fit._repr_html_()
        return f"<p><b>{head}</b><br>{because}</p>{tables}"
