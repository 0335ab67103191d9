"""The argument for a verdict, step by step; each step is a figure that could have contradicted the verdict.

The order: geometry alone, stages of the chain, residual maps before and after, rival models, where they differ, what to
measure next, and how well the parameters are known. The verdict is that of ``discover``; nothing is judged here.
"""

import yaml

from sandbot_model.discovery.next_trials import NextTrial
from sandbot_model.discovery.result import Discovery
from sandbot_model.physics.gait import ASSUMED
from sandbot_model.report import captions, model_difference, profiles, rivals, stages, table_sections, text
from sandbot_model.report.content import headline
from sandbot_model.report.curves import steps as with_curves
from sandbot_model.report.data_section import json_download
from sandbot_model.report.figure_sections import lock_figure, residual_figure
from sandbot_model.report.in_words import no_trial, spelled_out
from sandbot_model.report.page import Download, Figure, Page, Section, data_uri
from sandbot_model.report.view import Provenance, Step

Steps = tuple[Step, ...]
MAX_REPLICATES = 6
"""Most replicates per condition in the plan: a question that needs more is not settled in a day."""
PLAN = "next.yaml"


def argument_page(discovery: Discovery, provenance: Provenance, *, title: str, back: str = "") -> Page:
    """The page that argues for a verdict. ``back`` is the address of its link back."""
    verdict = discovery.verdict
    because = spelled_out(verdict.because, discovery.fit.model.catalogue)
    shown = with_curves(rivals.rivals(discovery))
    opened = min(1, len(shown) - 1)
    return Page(
        title=title,
        kind="Why: the argument for the verdict",
        back=back,
        status=verdict.status,
        sentence=f"{because[:1].upper()}{because[1:].rstrip('.')}.",
        headline=headline(shown[:2], discovery.noise_floor_m_s, provenance, discovery.cells),
        cautions=provenance.cautions,
        steps=tuple((step.label, f"error {text.cm_s(step.fit.rmse_m_s)}") for step in shown),
        opened=opened,
        sections=(
            *_geometry_lock(discovery),
            *_stages(discovery),
            _maps(shown, discovery),
            _rivals(shown, discovery),
            *_differences(shown),
            _next(shown, discovery),
            _parameters(shown[opened], shown[0]),
        ),
    )


def _geometry_lock(discovery: Discovery) -> list[Section]:
    cells = discovery.cells
    if not {"speed", "lift"} <= set(cells.observables):
        return []
    heading = "Do the legs hold? A test by geometry, with nothing fitted"
    return [Section("lock", heading, figures=(lock_figure(cells),))]


def _stages(discovery: Discovery) -> list[Section]:
    tested, alpha = discovery.stages, discovery.criteria.lack_of_fit
    if not tested:
        return []
    figure = Figure(
        "stages", (stages.stages_caption(tested, alpha),), "",
        lambda theme: [stages.stage_map(tested, discovery.cells, alpha, theme)],
    )  # fmt: skip
    heading = "Which stage of the base model fails?"
    return [Section("stages", heading, figures=(figure,), tables=(stages.stage_table(tested),))]


def _maps(shown: Steps, discovery: Discovery) -> Section:
    """Residual maps of each observable, the base model's on the left."""
    cells = discovery.cells
    maps = tuple(residual_figure(shown, observable) for observable in cells.observables)
    return Section("maps", "Where it fails, before and after", (captions.how_to_read("residuals", cells),), maps)


def _rivals(shown: Steps, discovery: Discovery) -> Section:
    labels = "; ".join(step.label for step in shown)
    alt = f"Mean speed against ω by {text.counted(len(shown), 'model')}: {labels}."
    figure = rivals.overlay_figure("rivals", shown, (alt,))
    tables = (rivals.comparison_table(shown, discovery.fits),)
    return Section("rivals", "What else could it be?", figures=(figure,), tables=tables)


def _differences(shown: Steps) -> list[Section]:
    """The model chosen above minus the one that the verdict names; that one itself minus the base model."""
    if len(shown) == 1:
        return []
    named = shown[1]
    against = [shown[0] if step is named else named for step in shown]
    observable = "speed"
    figure = Figure(
        "difference",
        tuple(model_difference.difference_caption(*pair, observable) for pair in zip(shown, against, strict=True)), "",
        lambda theme: [
            model_difference.difference_map(*pair, observable, theme) for pair in zip(shown, against, strict=True)
        ],
    )  # fmt: skip
    words = "The model chosen above minus the one the verdict names; that one itself minus the base model."
    return [Section("difference", "How far apart are two of the models?", (words,), (figure,))]


def _next(shown: Steps, discovery: Discovery) -> Section:
    """Where rivals differ most, and the trials that would distinguish them."""
    fits = [step.fit for step in (shown[1:] if len(shown) > 2 else shown)]
    trials = discovery.next_trials
    figures = (_separation(model_difference.gaps(fits), trials),) if len(fits) > 1 else ()
    tables = tuple(table for section in table_sections.next_trials(discovery) for table in section.tables)
    heading, how = "What would settle it?", _how_to_run(discovery)
    return Section("next", heading, how, figures, tables, downloads=_plan(discovery))


def _separation(gaps: model_difference.Gaps, trials: tuple[NextTrial, ...]) -> Figure:
    return Figure(
        "apart", (model_difference.separation_caption(gaps, trials),),
        "For each condition, the pair of models and the observable that differ most. The stronger the colour, the "
        "better a trial there distinguishes them.",
        lambda theme: [model_difference.separation_map(gaps, trials, theme)],
    )  # fmt: skip


def _how_to_run(discovery: Discovery) -> tuple[str, ...]:
    if not _walking_trials(discovery.next_trials):
        why = no_trial(discovery)
        return (f"{why[:1].upper()}{why[1:]}.",)
    return (f"Run the plan below with: trackway campaign {PLAN} --out runs/next",)


def _walking_trials(trials: tuple[NextTrial, ...]) -> list[NextTrial]:
    """The proposed measurements in which the robot walks, without penetrometry."""
    return [trial for trial in trials if trial.kind == "trial"]


def _plan(discovery: Discovery) -> tuple[Download, ...]:
    if not _walking_trials(discovery.next_trials):
        return (json_download(discovery),)
    content = data_uri(plan(discovery).encode(), "application/yaml")
    return Download(PLAN, f"Plan of these trials ({PLAN})", content), json_download(discovery)


def plan(discovery: Discovery) -> str:
    """A campaign plan (YAML) of the next walking trials: the first as its grid, the others as extra trials."""
    proposed = [
        {
            "phi": round(trial.phi, 4),
            "omega_rad_s": round(trial.omega_rad_s, 3),
            "replicates": min(trial.replicates, MAX_REPLICATES),
            "gait": trial.gait or ASSUMED,
        }
        for trial in _walking_trials(discovery.next_trials)
    ]
    first, *others = proposed
    content = {
        "name": "next", "gait": first["gait"], "phi": [first["phi"]], "omega_rad_s": [first["omega_rad_s"]],
        "replicates": first["replicates"], "extra_trials": others,
    }  # fmt: skip
    return yaml.safe_dump(content, sort_keys=False)


def _parameters(named: Step, base: Step) -> Section:
    """Profiles and correlations for the model that the verdict names."""
    figures = (
        Figure(
            "profiles", (profiles.profiles_caption(named),),
            f"{named.label}. Rise of the deviance as one parameter is held and all others are refitted. The standard "
            "error suffices where this profile is a parabola, not where it has a wall on one side, a floor or steps.",
            lambda theme: [profiles.profiles(named, theme)],
        ),
        Figure(
            "correlations", (profiles.correlations_caption(named),),
            f"{named.label}. Correlations of the errors; numbers where they are 0.3 and above.",
            lambda theme: [profiles.correlations(named, theme)],
        ),
    )  # fmt: skip
    tables = table_sections.parameters((base, named) if named is not base else (base,)).tables
    return Section("parameters", "How well are the parameters known?", figures=figures, tables=tables)
