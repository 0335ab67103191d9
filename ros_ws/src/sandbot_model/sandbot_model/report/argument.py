"""The argument for a verdict, step by step, each step a figure that could have gone against it.

Geometry alone, then the stages of the chain, the maps before and after, the rivals, where they differ, what to measure
next, and how well the parameters are known. The verdict itself is that of ``discover``; nothing is judged here.
"""

import yaml

from sandbot_model.discovery.discover import Discovery
from sandbot_model.discovery.next_trials import PENETRATION, NextTrial
from sandbot_model.physics.gait import ASSUMED
from sandbot_model.report import (
    apart,
    captions,
    lock,
    profiles,
    residual_map,
    rivals,
    stages,
    table_sections,
    text,
)
from sandbot_model.report.content import headline
from sandbot_model.report.curves import steps as with_curves
from sandbot_model.report.data_section import json_download
from sandbot_model.report.page import Download, Figure, Page, Section, data_uri
from sandbot_model.report.view import Provenance, Step

Steps = tuple[Step, ...]
MOST_REPLICATES = 6
"""Trials of one condition in the plan written: what takes more is not settled in a day."""
PLAN = "next.yaml"


def argument_page(discovery: Discovery, provenance: Provenance, *, title: str, back: str = "") -> Page:
    """The page that argues a verdict. ``back`` is the address that its link leads to."""
    verdict = discovery.verdict
    shown = with_curves(rivals.rivals(discovery))
    opened = min(1, len(shown) - 1)
    return Page(
        title=title,
        kind="Why: the argument for the verdict",
        back=back,
        status=verdict.status,
        sentence=f"{verdict.because[:1].upper()}{verdict.because[1:].rstrip('.')}.",
        headline=headline(shown[:2], discovery.noise_floor_m_s, provenance, discovery.cells),
        cautions=provenance.cautions,
        steps=tuple((step.label, f"error {text.cm_s(step.fit.rmse_m_s)}") for step in shown),
        opened=opened,
        sections=(
            *_lock(discovery),
            *_stages(discovery),
            _maps(shown, discovery),
            _rivals(shown, discovery),
            *_differ(shown),
            _next(shown, discovery),
            _parameters(shown[opened], shown[0]),
        ),
    )


def _lock(discovery: Discovery) -> list[Section]:
    cells = discovery.cells
    if not {"speed", "lift"} <= set(cells.observables):
        return []
    figure = Figure(
        "lock", (captions.lock(cells),), captions.HOW["lock"], lambda theme: [lock.geometry_lock(cells, theme)]
    )
    return [Section("lock", "Do the legs hold? What geometry says, with nothing fitted", figures=(figure,))]


def _stages(discovery: Discovery) -> list[Section]:
    tested = discovery.stages
    if not tested:
        return []
    figure = Figure(
        "stages", (stages.stages_say(tested),), "", lambda theme: [stages.stage_map(tested, discovery.cells, theme)]
    )
    heading = "Which stage of the base model fails?"
    return [Section("stages", heading, figures=(figure,), tables=(stages.stage_table(tested),))]


def _maps(shown: Steps, discovery: Discovery) -> Section:
    """Residuals of each observable, the base model's on the left."""

    def figure(observable: str) -> Figure:
        return Figure(
            f"residuals-{observable}", tuple(captions.residuals(step, observable) for step in shown), "",
            lambda theme: [residual_map.residual_map(step, observable, shown[0], theme) for step in shown],
        )  # fmt: skip

    names = discovery.cells.observables
    return Section("maps", "Where it fails, before and after", (captions.HOW["residuals"],), tuple(map(figure, names)))


def _rivals(shown: Steps, discovery: Discovery) -> Section:
    labels = "; ".join(step.label for step in shown)
    figure = Figure(
        "rivals", (f"Mean speed against ω by {len(shown)} models: {labels}.",),
        "Points: measured, bars one standard deviation of a trial. Lines: the models, the one chosen above is thicker.",
        lambda theme: [rivals.overlay(shown, n, theme) for n in range(len(shown))],
    )  # fmt: skip
    tables = (rivals.compared(shown, discovery.fits),)
    return Section("rivals", "What else could it be?", figures=(figure,), tables=tables)


def _differ(shown: Steps) -> list[Section]:
    """The model chosen above against the one that the verdict names, or against the base model."""
    if len(shown) == 1:
        return []
    named = shown[1]
    against = [shown[0] if step is named else named for step in shown]
    observable = "speed"
    figure = Figure(
        "difference",
        tuple(apart.difference_says(*pair, observable) for pair in zip(shown, against, strict=True)), "",
        lambda theme: [
            apart.difference_map(*pair, observable, theme) for pair in zip(shown, against, strict=True)
        ],
    )  # fmt: skip
    words = "The model chosen above less the one named; the one named is set against the base model."
    return [Section("difference", "How far are two of them apart?", (words,), (figure,))]


def _next(shown: Steps, discovery: Discovery) -> Section:
    """Where rivals differ most, and the trials that would settle it."""
    fits = [step.fit for step in (shown[1:] if len(shown) > 2 else shown)]
    trials = discovery.next_trials
    figures = (_apart(apart.gaps(fits), trials),) if len(fits) > 1 else ()
    tables = tuple(table for section in table_sections.next_trials(discovery) for table in section.tables)
    heading, how = "What would settle it?", _how_to_run(trials)
    return Section("next", heading, how, figures, tables, downloads=_plan(discovery))


def _apart(gaps: apart.Gaps, trials: tuple[NextTrial, ...]) -> Figure:
    return Figure(
        "apart", (apart.separation_says(gaps, trials),),
        "At each condition the pair of models and the observable that differ most. The stronger the colour, the more "
        "a trial tells.",
        lambda theme: [apart.separation_map(gaps, trials, theme)],
    )  # fmt: skip


def _how_to_run(trials: tuple[NextTrial, ...]) -> tuple[str, ...]:
    if not _walks(trials):
        return ("No further trial is asked for: none is needed, or none within reach would tell more.",)
    return (f"The plan below is run by: ros2 run sandbot_bringup campaign {PLAN} --out runs/next",)


def _walks(trials: tuple[NextTrial, ...]) -> list[NextTrial]:
    return [trial for trial in trials if trial.observable != PENETRATION]


def _plan(discovery: Discovery) -> tuple[Download, ...]:
    if not _walks(discovery.next_trials):
        return (json_download(discovery),)
    content = data_uri(plan(discovery).encode(), "application/yaml")
    return Download(PLAN, f"Plan of these trials ({PLAN})", content), json_download(discovery)


def plan(discovery: Discovery) -> str:
    """A campaign's plan with the next trials that are trials: the first as its grid, the others beside it."""
    asked = [
        {
            "phi": round(trial.phi, 4),
            "omega_rad_s": round(trial.omega_rad_s, 3),
            "replicates": min(trial.replicates, MOST_REPLICATES),
            "gait": trial.gait or ASSUMED,
        }
        for trial in _walks(discovery.next_trials)
    ]
    first, *others = asked
    content = {
        "name": "next", "gait": first["gait"], "phi": [first["phi"]], "omega_rad_s": [first["omega_rad_s"]],
        "replicates": first["replicates"], "extra_trials": others,
    }  # fmt: skip
    return yaml.safe_dump(content, sort_keys=False)


def _parameters(named: Step, base: Step) -> Section:
    """Of the model that the verdict names."""
    figures = (
        Figure(
            "profiles", (profiles.curves_say(named),),
            f"{named.label}. Rise of the deviance as one parameter is held and all others follow. A parabola: the "
            "standard error says all. A wall on one side, a floor or steps: it does not.",
            lambda theme: [profiles.profiles(named, theme)],
        ),
        Figure(
            "correlations", (profiles.correlations_say(named),), f"{named.label}. Correlations of the errors, at 0.3 "
            "and above as a number.", lambda theme: [profiles.correlations(named, theme)],
        ),
    )  # fmt: skip
    tables = table_sections.parameters((base, named) if named is not base else (base,)).tables
    return Section("parameters", "How well are the parameters known?", figures=figures, tables=tables)
