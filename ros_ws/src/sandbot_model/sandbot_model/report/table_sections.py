"""The sections of the page that hold tables, and the video: what was tried, fitted, missed, and comes next."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from markupsafe import Markup, escape

from sandbot_model.discovery.discover import Discovery
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.physics.typeset import mathml_lines, plain
from sandbot_model.report import text
from sandbot_model.report.page import Picture, Section, Table, data_uri
from sandbot_model.report.profiles import correlation
from sandbot_model.report.view import Step, band_name, observable_label, readable

Frames = Sequence[tuple[bytes, str]]
MAX_FAILING_ROWS = 60
BEST_CANDIDATES = 8
BESIDE = (
    "{} is fitted beside a zero of the lift, a scale of the speed and whatever else trials share; compare and the "
    "explorer fit it alone."
)


def candidates(discovery: Discovery) -> list[Section]:
    """The single effects, best first."""
    if not discovery.candidates:
        return []
    ranked = sorted(discovery.candidates, key=lambda c: c.delta_bic)
    rows = [
        (
            readable(c.effect), c.stage, text.number(c.delta_chi2), text.number(c.delta_bic),
            text.number(CM * c.cv_rmse_m_s, 2), text.probability(c.weight),
        )
        for c in ranked
    ]  # fmt: skip
    caption = (
        "Each effect added alone to the base model, best first. Δχ² and ΔBIC against the base model: the more "
        "negative, the better. Weight: share of belief over all sets tried that contain the effect."
    )
    head = ("effect", "acts on", "Δχ²", "ΔBIC", "out-of-sample error (cm/s)", "weight")
    words = (True, True, False, False, False, False)
    tables = [Table(caption, head, rows[:BEST_CANDIDATES], words)]
    if rest := rows[BEST_CANDIDATES:]:
        tables.append(Table(f"{len(rest)} more effects that help less", head, rest, words, folded=True))
    return [Section("candidates", "Effects tried", tables=tuple(tables))]


def limits(discovery: Discovery) -> list[Section]:
    """How large absent effects can be."""
    rows = [
        (*text.described(f"{limit.effect}.{limit.parameter}"), _end(limit.low), _end(limit.high))
        for limit in discovery.limits
    ]
    caption = "What effects that are not named can be at 95 % confidence; – where they end or these data set no limit."
    table = Table(caption, ("parameter", "unit", "above", "below"), rows, (True, True, False, False))
    return [Section("limits", "Effects that are absent", tables=(table,))] if rows else []


def _end(value: float | None) -> str:
    return "–" if value is None else f"{value:.2g}".replace("-", "−")


def residual(discovery: Discovery) -> list[Section]:
    """What no effect of the catalogue explains, as a formula to try."""
    residual = discovery.residual
    if residual is None:
        return []
    said = f"{residual.sentence[:1].upper()}{residual.sentence[1:]}.".replace("(-", "(−")
    add = f"To add it: compare DATA {residual.options}"
    return [Section("residual", "What the catalogue does not explain", text=(said, add))]


def parameters(steps: tuple[Step, ...]) -> Section:
    """What was fitted in each step, the last one first, and what its effects change."""
    last, backwards = steps[-1], steps[::-1]
    names = list(dict.fromkeys(name for step in steps for name in step.fit.parameters))
    rows = [(*text.described(name), *(_estimate(step.fit, name) for step in backwards)) for name in names]
    for i, phi in enumerate(last.fit.level_phi):
        words = ", stiffness of the ground under a leg" if i == 0 else ""
        rows.append((f"k at φ = {phi:.3f}{words}", "N/m", *(_stiffness(step.fit, i) for step in backwards)))
    order = " The last step stands first; each is headed by what it adds." if len(steps) > 1 else ""
    beside = "" if last.fit.nuisances is None else f" {BESIDE.format(last.label)}"
    table = Table(
        f"Fitted value ± standard error; – where the model does not have the parameter.{order}{beside}",
        ("parameter", "unit", *_added(steps)[::-1]),
        rows,
        (True, True, *(False for _ in steps)),
    )
    return Section("parameters", "Parameters", tables=(table, *_correlations(last), *_formulas(last.fit)))


def _added(steps: tuple[Step, ...]) -> list[str]:
    """What each step adds to the one before; its whole name where it is not that one with something added."""
    heads = [steps[0].label]
    for last, step in pairwise(steps):
        before, effects = set(last.fit.effects), step.fit.effects
        added = [f"+ {readable(name)}" for name in effects if name not in before]
        heads.append(" ".join(added) if added and before <= set(effects) else step.label)
    return heads


def _correlations(step: Step) -> list[Table]:
    """How the errors of the last step's shared parameters are correlated; a dash where there is no error."""
    names = list(step.fit.parameters)
    values = correlation(step.fit.covariance[: len(names), : len(names)])
    short = [name.rpartition(".")[2] for name in names]
    rows = [(name, *(_correlation(value) for value in row[: i + 1]), *[""] * (len(names) - i - 1))
            for i, (name, row) in enumerate(zip(names, values, strict=True))]  # fmt: skip
    caption = f"Correlations of the errors, {step.label}."
    return [Table(caption, ("parameter", *short), rows, (True, *(False for _ in names)))] if len(names) > 1 else []


def _correlation(value: float) -> str:
    return text.number(value, 2) if np.isfinite(value) else "–"


def _formulas(fit: Fit) -> list[Table]:
    """What each effect of the last step changes; nothing where there is no effect."""
    rows = [(readable(effect.identifier), effect.stage, _formula(effect)) for effect in fit.model.effects]
    caption = "What the effects change: → in the chain from clock to speed, with the parameters above."
    return [Table(caption, ("effect", "acts on", "formula, and where it is seen"), rows, (True,) * 3)] if rows else []


def _formula(effect: Effect) -> Markup:
    """Each statement on its own line, where the effect is seen below."""
    lines = [*mathml_lines(effect.formula), escape(f"seen in: {plain(effect.seen_in)}")]
    return Markup("").join(Markup(f'<div class="statement">{line}</div>') for line in lines)


def _estimate(fit: Fit, name: str) -> str:
    if name not in fit.parameters:
        return "–"
    flag = " (at its bound)" if name in fit.at_bounds else " (implausible)" if name in fit.implausible else ""
    return fit.parameter_text(name).replace("-", "−") + flag


def _stiffness(fit: Fit, level: int) -> str:
    return fit.value_text(float(fit.k_n_per_m[level]), float(fit.k_stderr_n_per_m[level]))


def next_trials(discovery: Discovery) -> list[Section]:
    """What to measure next."""
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
        "Measurements that would tell the remaining explanations apart, most telling first. Gap: difference of the "
        "two predictions in standard deviations of one of them.",
        ("at", "watch", "separates", "expected gap (s.d.)", "replicates to settle it"),
        rows,
        (True, True, True, False, False),
    )
    return [Section("next", "Next trials", tables=(table,))]


def failing(steps: tuple[Step, ...]) -> Section:
    """Which cell means each step misses."""
    tables = []
    for i, step in enumerate(steps):
        fails = sorted(step.fit.fails, key=lambda f: -abs(f.z))
        rows = [
            (
                observable_label(f.observable), band_name(step.fit.cells, f.cell), f"{f.omega_rad_s:.4g}",
                f"{text.number(CM * f.residual, 2)} {Observable[f.observable].readers_unit}", text.number(f.z),
            )
            for f in fails[:MAX_FAILING_ROWS]
        ]  # fmt: skip
        more = f", the worst {MAX_FAILING_ROWS} shown" if len(fails) > MAX_FAILING_ROWS else ""
        caption = f"{step.label}: {text.counted(len(fails), 'failing cell')}{more}. Residual: measured minus model."
        head = ("observable", "φ", "ω (rad/s)", "residual", "standard errors")
        tables.append(Table(caption, head, rows, (True, False, False, False, False), step=i, folded=len(rows) > 8))
    return Section("failing", "Failing cells", tables=tuple(tables))


def video(frames: Frames) -> list[Section]:
    """Tracked frames."""
    if not frames:
        return []
    pictures = tuple(Picture(data_uri(content, _media_type(content)), caption) for content, caption in frames)
    return [Section("frames", "Tracked video", pictures=pictures)]


def _media_type(content: bytes) -> str:
    return "image/png" if content.startswith(b"\x89PNG") else "image/jpeg"
