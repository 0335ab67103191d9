"""Table sections of the page, and the video: effects tried, limits, parameters, failing cells, next trials."""

from collections.abc import Sequence
from itertools import chain, pairwise

import numpy as np
from markupsafe import Markup, escape

from sandbot_model.discovery.result import Discovery
from sandbot_model.fitting.fit import Fit
from sandbot_model.fitting.goodness import Fail
from sandbot_model.fitting.text import NO_ERROR
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.physics.typeset import mathml_lines, plain
from sandbot_model.report import text
from sandbot_model.report.effect_facts import OBSERVABLES
from sandbot_model.report.page import Picture, Section, Table, data_uri
from sandbot_model.report.profiles import correlation
from sandbot_model.report.view import Step, band_name, is_ladder, observable_label, readable

Frames = Sequence[tuple[bytes, str]]
PNG = b"\x89PNG"
"""The first bytes of such a picture."""
MAX_FAILING_ROWS = 60
BEST_CANDIDATES = 8
NUISANCE_NOTE = (
    "{} is fitted with nuisance parameters (lift zero, speed scale and others that trials share); compare and the "
    "explorer fit it without."
)


def candidates(discovery: Discovery) -> list[Section]:
    """Table of the single effects, best first."""
    if not discovery.candidates:
        return []
    ranked = sorted(discovery.candidates, key=lambda c: c.delta_bic)
    implausible = discovery.only_implausible
    rows = [
        (
            f"{readable(c.effect)}{' *' * (c.effect in implausible)}", c.stage,
            text.number(c.delta_chi2), text.number(c.delta_bic), text.number(CM * c.cv_rmse_m_s, 2),
            str(c.cv_cells), text.probability(c.weight),
        )
        for c in ranked
    ]  # fmt: skip
    caption = (
        "Each effect added alone to the base model, best first. Δχ² and ΔBIC against the base model: the more "
        "negative, the better. Weight: sum of the BIC weights of all sets tried that contain the effect."
    )
    if listed := "; ".join(f"{readable(name)} with {values}" for name, values in implausible.items()):
        caption += f" * Only with implausible values, so not named: {listed}."
    head = ("effect", "acts on", "Δχ²", "ΔBIC", "out-of-sample error (cm/s)", "cells scored", "weight")
    words = (True, True, *[False] * 5)
    tables = [Table(caption, head, rows[:BEST_CANDIDATES], words)]
    if rest := rows[BEST_CANDIDATES:]:
        tables.append(Table(f"{len(rest)} more effects that help less", head, rest, words, folded=True))
    return [Section("candidates", "Effects tried", tables=tuple(tables))]


def limits(discovery: Discovery) -> list[Section]:
    """95 % limits on the parameters of effects that are not named."""
    rows = [
        (*text.described(f"{limit.effect}.{limit.parameter}"), *(end.replace("-", "−") or "–" for end in limit.ends))
        for limit in discovery.limits
    ]
    caption = (
        "Limits at 95 % confidence on effects that are not named; – where no value of the plausible range is excluded."
    )
    table = Table(caption, ("parameter", "unit", "above", "below"), rows, (True, True, False, False))
    return [Section("limits", "Effects that are absent", tables=(table,))] if rows else []


def residual(discovery: Discovery) -> list[Section]:
    """A formula for the residual that no effect of the catalogue explains."""
    residual = discovery.residual
    if residual is None:
        return []
    sentence = f"{residual.sentence[:1].upper()}{residual.sentence[1:]}.".replace("(-", "(−")
    add = f"To add it: compare DATA {residual.options}"
    return [Section("residual", "What the catalogue does not explain", text=(sentence, add))]


def parameters(steps: tuple[Step, ...]) -> Section:
    """Fitted parameters of each step, the last step first, with the formulas of its effects."""
    ladder = is_ladder(steps)
    last, columns, heads = steps[-1], steps[:: -1 if ladder else 1], _added(steps)[:: -1 if ladder else 1]
    names = list(dict.fromkeys(name for step in steps for name in step.fit.parameters))
    rows = [(*text.described(name), *(_estimate(step.fit, name) for step in columns)) for name in names]
    fits = [step.fit for step in columns]
    for i, phi in enumerate(last.fit.level_phi):
        words = ", stiffness of the ground under a leg" if i == 0 else ""
        rows.append(
            (
                f"k at φ = {phi:.3f}{words}",
                "N/m",
                *(fit.value_text(fit.k_n_per_m[i], fit.k_stderr_n_per_m[i]) for fit in fits),
            )
        )
    shown = steps[-1:] if ladder else steps[1:]
    order = " The last step comes first; each column is headed by what its step adds." if ladder and steps[1:] else ""
    nuisance_note = "" if last.fit.nuisances is None else f" {NUISANCE_NOTE.format(last.label)}"
    table = Table(
        f"Fitted value ± standard error, {NO_ERROR}; – where the model does not have the "
        f"parameter.{order}{nuisance_note}",
        ("parameter", "unit", *heads),
        rows,
        (True, True, *(False for _ in steps)),
    )
    return Section("parameters", "Parameters", tables=(table, *chain(*map(_correlations, shown)), *_formulas(shown)))


def _added(steps: tuple[Step, ...]) -> list[str]:
    """Effects that each step adds to the one before; its full label where the steps are not nested."""
    heads = [steps[0].label]
    for last, step in pairwise(steps):
        before, effects = set(last.fit.effects), step.fit.effects
        added = [f"+ {readable(name)}" for name in effects if name not in before]
        heads.append(" ".join(added) if added and before <= set(effects) else step.label)
    return heads


def _correlations(step: Step) -> list[Table]:
    """Correlations of the errors of a step's shared parameters; a dash where an error is unknown."""
    names = list(step.fit.parameters)
    if step.fit.undetermined or len(names) < 2:
        return []
    values = correlation(step.fit.covariance[: len(names), : len(names)])
    short = [name.rpartition(".")[2] for name in names]
    rows = [(name, *(_correlation(value) for value in row[: i + 1]), *[""] * (len(names) - i - 1))
            for i, (name, row) in enumerate(zip(names, values, strict=True))]  # fmt: skip
    caption = f"Correlations of the errors, {step.label}."
    return [Table(caption, ("parameter", *short), rows, (True, *(False for _ in names)))]


def _correlation(value: float) -> str:
    return text.number(value, 2) if np.isfinite(value) else "–"


def _formulas(steps: Sequence[Step]) -> list[Table]:
    """Formulas of the steps' effects; no table without effects."""
    effects = {effect.identifier: effect for step in steps for effect in step.fit.model.effects}
    rows = [(readable(name), effect.stage, _formula(effect)) for name, effect in effects.items()]
    caption = (
        "What the effects change: → in the chain from clock to speed, with the parameters above. Seen in: "
        f"{OBSERVABLES}."
    )
    return [Table(caption, ("effect", "acts on", "formula, and where it is seen"), rows, (True,) * 3)] if rows else []


def _formula(effect: Effect) -> Markup:
    """The formula, a line per statement, then the observables in which the effect is seen."""
    lines = [*mathml_lines(effect.formula), escape(f"seen in: {plain(effect.seen_in)}")]
    return Markup("").join(Markup(f'<div class="statement">{line}</div>') for line in lines)


def _estimate(fit: Fit, name: str) -> str:
    if name not in fit.parameters:
        return "–"
    flag = " (at its bound)" if name in fit.at_bounds else " (implausible)" if name in fit.implausible else ""
    return fit.parameter_text(name).replace("-", "−") + flag


def next_trials(discovery: Discovery) -> list[Section]:
    """Tables of the proposed measurements, and of controls where no trial distinguishes the explanations."""
    tables = (*_proposed(discovery), *_controls(discovery))
    return [Section("next", "Next trials", tables=tables)] if tables else []


def _controls(discovery: Discovery) -> list[Table]:
    rows = [(readable(name), control) for name, control in discovery.controls.items()]
    caption = "Experiments of another kind: no trial within this range of φ and ω distinguishes these explanations."
    return [Table(caption, ("effect", "control, and how the effect shows in it"), rows, (True, True))] if rows else []


def _proposed(discovery: Discovery) -> list[Table]:
    if not discovery.next_trials:
        return []
    rows = [
        (
            t.where, observable_label(t.observable),
            " from ".join(map(readable, t.separates)), text.number(t.expected_gap_sd), str(t.replicates),
        )
        for t in discovery.next_trials
    ]  # fmt: skip
    table = Table(
        "Measurements that would distinguish the remaining explanations, most informative first. Gap: difference of "
        "the two predictions in standard deviations of one trial.",
        ("at", "watch", "separates", "expected gap (s.d.)", "replicates to settle it"),
        rows,
        (True, True, True, False, False),
    )
    return [table]


def failing(steps: tuple[Step, ...]) -> list[Section]:
    """Tables of the cell means that each step misses; none where no step can be tested."""
    tables = []
    for i, step in enumerate(steps):
        if not np.isfinite(step.fit.lack_of_fit_p):
            continue
        fails = sorted(step.fit.fails, key=lambda f: -abs(f.z))
        rows = [
            (
                observable_label(f.observable), band_name(step.fit.cells, f.cell), f"{f.omega_rad_s:.4g}",
                _residual(f), text.number(f.z),
            )
            for f in fails[:MAX_FAILING_ROWS]
        ]  # fmt: skip
        more = f", the worst {MAX_FAILING_ROWS} shown" if len(fails) > MAX_FAILING_ROWS else ""
        count = f"{text.counted(len(fails), 'failing cell')}{more}. Residual: measured minus model"
        caption = f"{step.label}: {count if fails else 'no failing cells'}."
        head = ("observable", "φ", "ω (rad/s)", "residual", "standard errors")
        tables.append(Table(caption, head, rows, (True, False, False, False, False), step=i, folded=len(rows) > 8))
    return [Section("failing", "Failing cells", tables=tuple(tables))] if tables else []


def _residual(fail: Fail) -> str:
    rounded = text.to_error(CM * fail.residual, CM * fail.stderr).replace("-", "−")
    return f"{rounded} {Observable[fail.observable].readers_unit}"


def video(frames: Frames) -> list[Section]:
    """Tracked frames."""
    if not frames:
        return []
    pictures = tuple(
        Picture(data_uri(content, "image/png" if content.startswith(PNG) else "image/jpeg"), caption)
        for content, caption in frames
    )
    return [Section("frames", "Tracked video", pictures=pictures)]
