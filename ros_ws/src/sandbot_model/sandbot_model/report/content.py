"""From what was fitted and discovered to the sections of the page: words, tables, and which figure stands where."""

import csv
import io
import json
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from sandbot_model.data.conditions import Cells, noise_floor
from sandbot_model.discovery.discover import Discovery
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.observables import CM, Observable
from sandbot_model.physics.typeset import mathml
from sandbot_model.report import balance, captions, figures, mechanics, run_order, text
from sandbot_model.report.page import Download, Figure, Page, Section, Table, data_uri
from sandbot_model.report.view import (
    Provenance,
    Step,
    frequencies,
    measured,
    observable_label,
    readable,
    residual_z,
    scatter,
)
from sandbot_record.trials.table import Trials

Frames = Sequence[tuple[bytes, str]]
MAX_FAILING_ROWS = 60
BEST_CANDIDATES = 8


def discovery_page(
    discovery: Discovery,
    steps: tuple[Step, ...],
    provenance: Provenance,
    *,
    title: str,
    trials: Trials,
    frames: Frames = (),
    truth_line: str | None = None,
) -> Page:
    """The page of ``discover``: verdict, figures, candidates, next trials."""
    verdict = discovery.verdict
    cells = discovery.cells
    return Page(
        title=title,
        kind="Where the walking model fails, and what repairs it",
        status=verdict.status,
        sentence=_sentence(verdict.because, steps, discovery.noise_floor_m_s),
        headline=headline(steps, discovery.noise_floor_m_s, provenance, cells),
        truth_line=truth_line,
        cautions=provenance.cautions,
        steps=_step_names(steps),
        sections=(
            *_figure_sections(steps, discovery.noise_floor_m_s),
            *_run_order(trials, steps),
            *_candidates(discovery),
            *_limits(discovery),
            *_residual(discovery),
            _parameters(steps),
            *_next_trials(discovery),
            _failing(steps),
            *_frames(frames),
            _data(steps, provenance, [_json_download(discovery)]),
        ),
    )


def comparison_page(steps: tuple[Step, ...], provenance: Provenance, *, title: str, frames: Frames = ()) -> Page:
    """The page of ``compare``: the fits as given, in order, without a verdict."""
    cells = steps[0].fit.cells
    floor = noise_floor(cells)["speed"]
    return Page(
        title=title,
        kind="Walking model against trials",
        sentence=_comparison_sentence(steps, floor),
        headline=headline(steps, floor, provenance, cells),
        cautions=provenance.cautions,
        steps=_step_names(steps),
        sections=(
            *_figure_sections(steps, floor),
            _parameters(steps),
            _failing(steps),
            *_frames(frames),
            _data(steps, provenance, []),
        ),
    )


def headline(
    steps: tuple[Step, ...], noise_floor_m_s: float, provenance: Provenance, cells: Cells
) -> tuple[tuple[str, str, str], ...]:
    """The few numbers at the top: (term, value, meaning)."""
    first, last = steps[0].fit, steps[-1].fit
    terms = [(f"Error, {steps[0].label}", text.cm_s(first.rmse_m_s), _out_of_sample(first))]
    if len(steps) > 1:
        terms.append((f"Error, {steps[-1].label}", text.cm_s(last.rmse_m_s), _out_of_sample(last)))
    terms.append(("Noise floor", text.cm_s(noise_floor_m_s), "scatter of mean speed between replicates"))
    levels, omegas = len(cells.level_phi), len(frequencies(cells)[0])
    plan = f"{len(cells)} conditions over {levels} φ and {omegas} ω"
    terms.append(("Trials", str(provenance.used), plan))
    return tuple(terms)


def _out_of_sample(fit: Fit) -> str:
    return f"r.m.s. of mean speed; {text.cm_s(fit.cv_rmse_m_s)} out of sample"


def _sentence(because: str, steps: tuple[Step, ...], floor: float) -> str:
    """The verdict's reason, and what it does to the error."""
    reason = because[:1].upper() + because[1:].rstrip(".")
    return f"{reason}. {_comparison_sentence(steps, floor)}"


def _comparison_sentence(steps: tuple[Step, ...], floor: float) -> str:
    first, last = steps[0], steps[-1]
    if len(steps) == 1:
        return (
            f"The {first.label} leaves {text.cm_s(first.fit.rmse_m_s)} of error; the noise floor is {text.cm_s(floor)}."
        )
    change = "falls" if last.fit.rmse_m_s < first.fit.rmse_m_s else "does not fall:"
    return (
        f"With {last.label.removeprefix('+ ')} the error of mean speed {change} from {text.cm_s(first.fit.rmse_m_s)} "
        f"to {text.cm_s(last.fit.rmse_m_s)}; the noise floor is {text.cm_s(floor)}."
    )


def _step_names(steps: tuple[Step, ...]) -> tuple[tuple[str, str], ...]:
    return tuple((step.label, f"error {text.cm_s(step.fit.rmse_m_s)}") for step in steps)


def _figure_sections(steps: tuple[Step, ...], floor: float) -> list[Section]:
    cells = steps[0].fit.cells
    omega = captions.worst_frequency(steps[0].fit)
    sections = [
        Section("speed", "Speed against leg frequency", figures=(_speed_figure(steps),)),
        Section(
            "residuals",
            "Where the model fails",
            text=(captions.HOW["residuals"],),
            figures=tuple(_residual_figure(steps, name) for name in cells.observables),
        ),
        Section(
            "ladder", "Error as effects are added", figures=(_ladder_figure(steps, floor),), tables=(_errors(steps),)
        ),
    ]
    if {"speed", "lift"} <= set(cells.observables):
        lock = Section("lock", "The geometry lock: lift against speed", figures=(_lock_figure(cells),))
        sections.append(lock)
    sections += [
        Section("collapse", "Where walking collapses", figures=(_collapse_figure(steps),)),
        Section("step", "Step length", figures=(_step_figure(steps),)),
        Section(
            "balance", f"Force balance at ω = {omega:.3g} rad/s, where the base model misses most",
            figures=(_balance_figure(steps, omega),),
        ),
    ]  # fmt: skip
    return sections


def _speed_figure(steps: tuple[Step, ...]) -> Figure:
    return Figure(
        name="speed",
        alt=tuple(captions.speed(step) for step in steps),
        caption=captions.HOW["speed"],
        draw=lambda theme: [figures.speed(step, steps[0], theme) for step in steps],
    )


def _residual_figure(steps: tuple[Step, ...], observable: str) -> Figure:
    return Figure(
        name=f"residuals-{observable}",
        alt=tuple(captions.residuals(step, observable) for step in steps),
        caption="",
        draw=lambda theme: [figures.residual_map(step, observable, steps[0], theme) for step in steps],
    )


def _run_order(trials: Trials, steps: tuple[Step, ...]) -> list[Section]:
    """Residuals in the order in which the trials were run, where that is known."""
    if not run_order.drawable(trials, steps[-1].fit):
        return []
    figure = Figure(
        name="run-order",
        alt=tuple(run_order.caption(trials, step.fit) for step in steps),
        caption="",
        draw=lambda theme: [run_order.figure(trials, step.fit, theme) for step in steps],
    )
    return [Section("order", "Residuals in run order", figures=(figure,))]


def _ladder_figure(steps: tuple[Step, ...], floor: float) -> Figure:
    return Figure(
        name="ladder",
        alt=(captions.ladder(steps, floor),),
        caption=captions.HOW["ladder"],
        draw=lambda theme: [figures.ladder(steps, floor, i, theme) for i in range(len(steps))],
    )


def _errors(steps: tuple[Step, ...]) -> Table:
    """Error per observable, in sample and out of it, for each step and for the replicates alone."""
    cells = steps[0].fit.cells
    floor = noise_floor(cells)
    head = [
        "model",
        *(Observable[name].heading for name in cells.observables),
        "lack of fit, p",
        "failing cells",
    ]
    rows = []
    for step in steps:
        errors = (
            f"{text.centi(step.fit.goodness.rmse[n])} / {text.centi(step.fit.cross_validation.rmse[n])}"
            for n in cells.observables
        )
        failing = len({(fail.phi, fail.omega_rad_s) for fail in step.fit.fails})
        rows.append((step.label, *errors, text.probability(step.fit.lack_of_fit_p), f"{failing} of {len(cells)}"))
    rows.append(("noise floor", *(text.centi(floor[name]) for name in cells.observables), "", ""))
    caption = (
        "Error in sample / out of sample, per observable. Lack of fit: how often replicates alone would miss the model "
        "by as much."
    )
    return Table(caption, tuple(head), rows, (True, *(False for _ in head[1:])))


def _lock_figure(cells: Cells) -> Figure:
    return Figure(
        name="lock",
        alt=(captions.lock(cells),),
        caption=captions.HOW["lock"],
        draw=lambda theme: [figures.geometry_lock(cells, theme)],
    )


def _collapse_figure(steps: tuple[Step, ...]) -> Figure:
    return Figure(
        name="collapse",
        alt=tuple(captions.critical(step) for step in steps),
        caption=captions.HOW["critical"],
        draw=lambda theme: [mechanics.critical(step, theme) for step in steps],
    )


def _step_figure(steps: tuple[Step, ...]) -> Figure:
    return Figure(
        name="step",
        alt=tuple(captions.step_ratio(step) for step in steps),
        caption=captions.HOW["step"],
        draw=lambda theme: [mechanics.step_ratio(step, theme) for step in steps],
    )


def _balance_figure(steps: tuple[Step, ...], omega_rad_s: float) -> Figure:
    return Figure(
        name="balance",
        alt=tuple(captions.balance(step, omega_rad_s) for step in steps),
        caption=captions.HOW["balance"],
        draw=lambda theme: [balance.force_balance(step, omega_rad_s, steps[0], theme) for step in steps],
    )


def _candidates(discovery: Discovery) -> list[Section]:
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


def _limits(discovery: Discovery) -> list[Section]:
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


def _residual(discovery: Discovery) -> list[Section]:
    """What no effect of the catalogue explains, as a formula to try."""
    residual = discovery.residual
    if residual is None:
        return []
    said = f"{residual.sentence[:1].upper()}{residual.sentence[1:]}."
    add = f"To add it: compare DATA {residual.options}"
    return [Section("residual", "What the catalogue does not explain", text=(said, add))]


def _parameters(steps: tuple[Step, ...]) -> Section:
    names = list(dict.fromkeys(name for step in steps for name in step.fit.parameters))
    rows = [(*text.described(name), *(_estimate(step.fit, name) for step in steps)) for name in names]
    first = steps[0].fit
    for i, phi in enumerate(first.level_phi):
        values = (text.with_error(float(s.fit.k_n_per_m[i]), float(s.fit.k_stderr_n_per_m[i])) for s in steps)
        rows.append((f"k at φ = {phi:.3f}, stiffness of the ground under a leg", "N/m", *values))
    table = Table(
        "Fitted value ± standard error; – where the model does not have the parameter.",
        ("parameter", "unit", *(step.label for step in steps)),
        rows,
        (True, True, *(False for _ in steps)),
    )
    return Section("parameters", "Parameters", tables=(table, *_formulas(steps[-1].fit)))


def _formulas(fit: Fit) -> list[Table]:
    """What each effect of the last step changes; nothing where there is no effect."""
    rows = [
        (readable(effect.identifier), effect.stage, Markup(mathml(effect.formula)), effect.seen_in)
        for effect in fit.model.effects
    ]
    caption = "What the effects change: → in the chain from clock to speed, with the parameters above."
    return [Table(caption, ("effect", "acts on", "formula", "seen in"), rows, (True,) * 4)] if rows else []


def _estimate(fit: Fit, name: str) -> str:
    if name not in fit.parameters:
        return "–"
    value, stderr = fit.parameters[name]
    flag = " (at its bound)" if name in fit.at_bounds else " (implausible)" if name in fit.implausible else ""
    return text.with_error(value, stderr) + flag


def _next_trials(discovery: Discovery) -> list[Section]:
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


def _failing(steps: tuple[Step, ...]) -> Section:
    tables = []
    for i, step in enumerate(steps):
        fails = sorted(step.fit.fails, key=lambda f: -abs(f.z))
        rows = [
            (
                observable_label(f.observable), f"{f.phi:.3f}", f"{f.omega_rad_s:.4g}",
                f"{text.number(CM * f.residual, 2)} {Observable[f.observable].readers_unit}", text.number(f.z),
            )
            for f in fails[:MAX_FAILING_ROWS]
        ]  # fmt: skip
        more = f", the worst {MAX_FAILING_ROWS} shown" if len(fails) > MAX_FAILING_ROWS else ""
        caption = f"{step.label}: {len(fails)} failing cells{more}. Residual: measured minus model."
        head = ("observable", "φ", "ω (rad/s)", "residual", "standard errors")
        tables.append(Table(caption, head, rows, (True, False, False, False, False), step=i, folded=len(rows) > 8))
    return Section("failing", "Failing cells", tables=tuple(tables))


def _frames(frames: Frames) -> list[Section]:
    if not frames:
        return []
    pictures = tuple((data_uri(content, _media_type(content)), caption) for content, caption in frames)
    return [Section("frames", "Tracked video", pictures=pictures)]


def _media_type(content: bytes) -> str:
    return "image/png" if content.startswith(b"\x89PNG") else "image/jpeg"


def _data(steps: tuple[Step, ...], provenance: Provenance, downloads: list[Download]) -> Section:
    line = f"{provenance.used} trials used, {len(provenance.excluded)} excluded."
    tables = [_cell_table(steps)]
    if provenance.excluded:
        tables.insert(0, Table("Trials excluded", ("trial", "why"), list(provenance.excluded), (True, True)))
    sheet = Download("cells.csv", "Cells as CSV (SI units)", data_uri(cells_csv(steps).encode(), "text/csv"))
    return Section("data", "Data", text=(line,), tables=tuple(tables), downloads=(sheet, *downloads))


def _cell_table(steps: tuple[Step, ...]) -> Table:
    cells = steps[0].fit.cells
    head = ["φ", "ω (rad/s)", "trials"]
    trials = cells.n[:, Observable.speed]
    columns = [[f"{p:.3f}" for p in cells.phi], [f"{w:.4g}" for w in cells.omega], [str(n) for n in trials]]
    for name in cells.observables:
        head.append(Observable[name].heading)
        pairs = zip(CM * measured(cells, name), CM * scatter(cells, name), strict=True)
        columns.append([f"{m:.2f} ± {s:.2f}" if np.isfinite(m) else "–" for m, s in pairs])
    for step in steps:
        head.append(f"speed, {step.label} (cm/s)")
        columns.append([f"{CM * value:.2f}" for value in step.fit.predicted[:, Observable.speed]])
    rows = list(zip(*columns, strict=True))
    caption = "All cells: mean ± standard deviation of a single trial, and the modelled mean speed"
    return Table(caption, tuple(head), rows, (False,) * len(head), folded=True)


def cells_csv(steps: tuple[Step, ...]) -> str:
    """Cell means, scatter, and every step's prediction and residual, SI units in the names, empty where not known."""
    cells = steps[0].fit.cells
    columns: dict[str, Iterable[Any]] = {"phi": cells.phi, "omega_rad_s": cells.omega, "gait": cells.gait}
    for name in cells.observables:
        observable = Observable[name]
        columns |= {
            f"{name}_n": cells.n[:, observable],
            observable.column: cells.mean[:, observable],
            observable.column.replace(name, f"{name}_sd"): cells.sd[:, observable],
        }
        for step in steps:
            tag = "+".join(step.fit.effects) or "base"
            columns[f"{observable.column}[{tag}]"] = step.fit.predicted[:, observable]
            columns[f"{name}_z[{tag}]"] = residual_z(step.fit, name)
    sheet = io.StringIO()
    writer = csv.writer(sheet, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_csv_cell(v) for v in row] for row in zip(*columns.values(), strict=True))
    return sheet.getvalue()


def _csv_cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.7g}" if np.isfinite(value) else ""
    return str(value)


def _json_download(discovery: Discovery) -> Download:
    content = json.dumps(discovery.to_dict(), indent=1, ensure_ascii=False).encode()
    return Download("discovery.json", "Discovery as JSON (SI units)", data_uri(content, "application/json"))
