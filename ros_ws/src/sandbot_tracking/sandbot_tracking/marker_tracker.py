"""Follows named markers from frame to frame: reports lost ones, finds them again, and never swaps them.

Each marker is searched for where constant velocity predicts it. If it is not there it is missing (NaN, and counted) and
then searched for in a wider gate, next to its still visible neighbour, and finally in the whole frame, as far as it may
have moved meanwhile. A similar disc farther away, such as a reflection, is rejected even if it is the only one, and so
is one that was already there while the marker was in sight (distractors.py). Markers of one camera are on a rigid body,
so they keep their order along the image and nearly their distance: markers that violate this are dropped and counted as
ambiguous.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Floats, Frame
from sandbot_common.errors import InputError
from sandbot_common.parameters import parameter
from sandbot_tracking.bed import StillBed
from sandbot_tracking.disc import GREY_STEP, RADIUS
from sandbot_tracking.distractors import Distractors
from sandbot_tracking.markers import Appearance, detect, follow, is_marker

LEARN_EVERY = 4
"""Frames between updates of bed and distractors: they change slowly, and an update costs ten times a marker."""


@dataclass(frozen=True)
class Gates:
    """Tolerances of a marker's position and appearance."""

    gate_px: float = parameter(10.0, unit="px", doc="half-width of the search around a prediction", low=1.0, high=200.0)
    growth_px: float = parameter(3.0, unit="px", doc="added to the gate for each frame missed", low=0.0, high=50.0)
    patience: int = parameter(5, doc="frames missed before the whole frame is searched", low=1, high=1000)
    spacing: float = parameter(
        0.1, doc="tolerated change of the distance between markers (part of it)", low=0.0, high=0.5
    )
    area: float = parameter(
        0.25, doc="tolerated change of a marker's area (part of it): beyond, it is half hidden", low=0.05, high=1.0
    )


@dataclass(frozen=True)
class Marks:
    """The markers in one frame, in the order of the tracker's names."""

    xy_px: Floats
    """Centres, (n, 2); NaN where missing."""
    var_px2: Floats
    """Their variances, (n, 2); NaN where missing."""
    found: NDArray[np.bool_]
    """(n,)."""


@dataclass
class Counts:
    """Counts so far, in frames times markers (``frames``: in frames)."""

    frames: int = 0
    missing: int = 0
    lost: int = 0
    reacquired: int = 0
    ambiguous: int = 0


class MarkerTracker:
    """Follows ``names`` markers, named in the order of increasing image x.

    ``spacing_px``: the expected distance between the first and the last of several markers; if None, learnt when they
    are first seen. ``ignore_px``: rectangles (x, y, width, height) without markers (the sync LED).
    """

    def __init__(
        self, names: Sequence[str], spacing_px: float | None = None, ignore_px: Sequence[tuple[int, int, int, int]] = ()
    ) -> None:
        if not names or len(set(names)) != len(names):
            raise InputError(f"marker names {list(names)}: at least one and all different are needed")
        self.names = tuple(names)
        self.counts = Counts()
        self._appearance, self._gates = Appearance(), Gates()
        self._spacing, self._ignore = spacing_px, tuple(ignore_px)
        n = len(names)
        self._bed, self._distractors = StillBed(), Distractors()
        self._xy = np.full((n, 2), np.nan)
        self._velocity = np.zeros((n, 2))
        self._fastest = np.zeros(n)
        self._radius = np.full(n, np.nan)
        self._missed = np.full(n, self._gates.patience, dtype=int)
        self._unseen = self._missed.copy()
        self._seen_before = np.zeros(n, dtype=bool)
        self._offset = np.full((n, 2), np.nan)

    def update(self, frame: Frame, passed: int = 1) -> Marks:
        """The markers in the next frame, mono8 (height, width).

        Frames come at a steady rate; ``passed`` is the number of frame periods since the last: above 1 after a loss.
        """
        if frame.ndim != 2 or frame.dtype != np.uint8:
            raise InputError(f"frame of shape {frame.shape} and type {frame.dtype}: mono8 (height, width) is needed")
        # Markers moved on during lost frames.
        self._unseen += passed - 1
        rows = self._search_near(frame)
        if (self._missed + np.isnan(rows[:, 0]) > self._gates.patience).any():
            rows = self._acquire(frame, rows)
        rows = self._consistent(rows)
        self._update_state(rows)
        found = np.isfinite(rows[:, 0])
        if self.counts.frames % LEARN_EVERY == 0:
            self._bed.see(frame, self._xy, self._radius)
            if found.all():
                self._distractors.see(frame, self._xy)
        return Marks(rows[:, :2].copy(), rows[:, 2:4].copy(), found)

    def _search_near(self, frame: Frame) -> Floats:
        """Markers near their predicted positions; NaN for those not found."""
        where = self._xy + self._velocity
        where[(self._missed > self._gates.patience) | ~self._seen_before] = np.nan
        gates = self._gates.gate_px + self._gates.growth_px * self._missed
        rows = follow(frame, where, self._radius, gates, self._bed.picture)
        for i, row in enumerate(rows):
            near = np.hypot(*(row[:2] - where[i])) <= gates[i] + 1.0
            other = self._missed[i] > 0 and self._distractors.among(row[None])[0]
            if not (near and self._resembles(row, i)) or self._ignored(row) or other:
                rows[i] = np.nan
        return rows

    def _resembles(self, row: Floats, i: int) -> bool:
        """Whether a disc looks like marker ``i``: a marker of the same area."""
        if not is_marker(row, self._appearance):
            return False
        return not self._seen_before[i] or abs((row[RADIUS] / self._radius[i]) ** 2 - 1.0) <= self._gates.area

    def _ignored(self, row: Floats) -> bool:
        return any(x <= row[0] <= x + w and y <= row[1] <= y + h for x, y, w, h in self._ignore)

    def _acquire(self, frame: Frame, rows: Floats) -> Floats:
        """Find missing markers in the whole frame, if that is possible in one way only."""
        candidates = self._candidates(frame)
        alike = [choice for choice in combinations(candidates, len(rows)) if self._fits(choice, rows)]
        choices = [choice for choice in alike if self._within_reach(choice, rows)]
        if len(choices) == 1:
            return np.array(choices[0])
        if choices:
            best = self._clearly_best(choices)
            answer = rows if best is None else np.array(best)
        else:
            answer = self._acquire_by_neighbour(rows, candidates)
        if alike:
            self.counts.ambiguous += int(np.isnan(answer[:, 0]).sum())
        return answer

    def _candidates(self, frame: Frame) -> list[Floats]:
        """Marker-like discs of the frame as rows, by increasing x; at most the eight brightest."""
        discs = detect(frame, self._appearance, self._bed.picture)
        table = np.column_stack(
            (discs.xy_px, discs.var_px2, discs.radius_px, discs.contrast, np.ones(len(discs.radius_px)))
        )
        rows = [row for row in table[~self._distractors.among(table)] if not self._ignored(row)]
        return sorted(rows[:8], key=lambda row: float(row[0]))

    def _fits(self, choice: tuple[Floats, ...], rows: Floats) -> bool:
        """Whether candidates (ordered along x) can be the markers: appearance and distance are right, and markers in
        sight stay where they are."""
        table = np.array(choice)
        for i, row in enumerate(table):
            if not self._resembles(row, i):
                return False
            if np.isfinite(rows[i, 0]) and np.hypot(*(row[:2] - rows[i, :2])) > 1.0:
                return False
        return self._spaced(table)

    def _within_reach(self, choice: tuple[Floats, ...], rows: Floats) -> bool:
        """Whether the missing markers may have moved so far from their last positions."""
        away = np.hypot(*(np.array(choice)[:, :2] - self._xy).T)
        return bool((np.isfinite(rows[:, 0]) | ~self._seen_before | (away <= self._reach())).all())

    def _reach(self) -> Floats:
        """How far each marker may be from its last position, (n,) [px], at its largest motion per frame so far."""
        return np.asarray(self._gates.gate_px + np.maximum(self._gates.growth_px, self._fastest) * self._unseen)

    def _spaced(self, table: Floats) -> bool:
        if len(table) < 2 or self._spacing is None:
            return True
        gap = float(np.hypot(*(table[-1, :2] - table[0, :2])))
        return abs(gap / self._spacing - 1.0) <= self._gates.spacing

    def _clearly_best(self, choices: list[tuple[Floats, ...]]) -> tuple[Floats, ...] | None:
        """The choice nearest to the markers' last positions or, at first, the brightest and most equal in size; None
        if two choices are nearly as good."""
        if self._seen_before.all():
            cost = [float(np.hypot(*(np.array(c)[:, :2] - self._xy).T).mean()) for c in choices]
            margin = self._gates.gate_px
        else:
            cost = [
                float(np.ptp([row[RADIUS] for row in c]) * 10 - np.mean([row[GREY_STEP] for row in c])) for c in choices
            ]
            margin = 0.15 * self._appearance.contrast
        order = np.argsort(cost)
        return choices[order[0]] if cost[order[1]] - cost[order[0]] > margin else None

    def _acquire_by_neighbour(self, rows: Floats, candidates: list[Floats]) -> Floats:
        """Missing markers at their learnt offsets from a visible neighbour."""
        visible = np.flatnonzero(np.isfinite(rows[:, 0]))
        if not visible.size:
            return self._acquire_single(rows, candidates)
        anchor, answer = visible[0], rows.copy()
        for i in np.flatnonzero(np.isnan(rows[:, 0])):
            where = rows[anchor, :2] + self._offset[i] - self._offset[anchor]
            near = [c for c in candidates if np.hypot(*(c[:2] - where)) <= self._gates.gate_px]
            near = [c for c in near if self._resembles(c, int(i))]
            if len(near) == 1:
                answer[i] = near[0]
        return answer

    def _acquire_single(self, rows: Floats, candidates: list[Floats]) -> Floats:
        """A single disc while all markers are lost: it is accepted only if exactly one marker can be there."""
        if len(candidates) != 1 or not self._seen_before.all() or len(rows) == 1:
            return rows
        disc = candidates[0]
        distance = np.hypot(*(self._xy - disc[:2]).T)
        nearest, answer = int(np.argmin(distance)), rows.copy()
        reach = self._reach()[nearest]
        others = np.delete(distance, nearest)
        if distance[nearest] < reach and (others > 2 * reach).all() and self._resembles(disc, nearest):
            answer[nearest] = disc
        elif np.isfinite(distance).all():
            self.counts.ambiguous += 1
        return answer

    def _consistent(self, rows: Floats) -> Floats:
        """Drop all markers of a frame in which their order or distance is wrong."""
        seen = rows[np.isfinite(rows[:, 0])]
        ordered = bool((np.diff(seen[:, 0]) > 0).all())
        if ordered and (len(seen) < len(rows) or self._spaced(rows)):
            return rows
        self.counts.ambiguous += len(seen)
        self._missed[:] = self._gates.patience
        self._unseen = np.maximum(self._unseen, self._gates.patience)
        return np.full_like(rows, np.nan)

    def _update_state(self, rows: Floats) -> None:
        found = np.isfinite(rows[:, 0])
        gone = ~found & self._seen_before & (self._missed == 0)
        back = found & self._seen_before & (self._missed > 0)
        held = found & (self._missed == 0)
        self.counts.frames += 1
        self.counts.missing += int((~found).sum())
        self.counts.lost += int(gone.sum())
        self.counts.reacquired += int(back.sum())

        # The velocity is the last step alone: a leg catches within one frame, and an average would lag behind.
        step = np.where(held[:, None], rows[:, :2] - self._xy, 0.0)
        self._fastest = np.maximum(self._fastest, np.hypot(*step.T))
        self._velocity = np.where(found[:, None], step, self._velocity * 0.5)
        drift = self._xy + np.where(self._missed[:, None] < self._gates.patience, self._velocity, 0.0)
        self._xy = np.where(found[:, None], rows[:, :2], drift)
        first = found & ~self._seen_before
        usual = 0.98 * self._radius + 0.02 * rows[:, RADIUS]
        self._radius = np.where(first, rows[:, RADIUS], np.where(found, usual, self._radius))
        self._missed = np.where(found, 0, self._missed + 1)
        self._unseen = np.where(found, 0, self._unseen + 1)
        self._seen_before |= found
        if found.all():
            self._offset = rows[:, :2] - rows[0, :2]
            if self._spacing is None and len(rows) > 1:
                self._spacing = float(np.hypot(*self._offset[-1]))
