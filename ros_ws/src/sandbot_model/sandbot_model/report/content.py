"""Assembles the page from fits and discovery: text, tables, and the order of the figures."""

from collections.abc import Sequence

from sandbot_model.data.conditions import Cells, noise_floor
from sandbot_model.discovery.discover import Discovery
from sandbot_model.fitting.fit import Fit
from sandbot_model.report import table_sections as tables
from sandbot_model.report import text
from sandbot_model.report.data_section import data, json_download
from sandbot_model.report.figure_sections import figure_sections, run_order_section
from sandbot_model.report.page import Page, Section
from sandbot_model.report.table_sections import Frames
from sandbot_model.report.view import Provenance, Step, frequencies
from sandbot_record.trials.table import Trials


def discovery_page(
    discovery: Discovery,
    steps: tuple[Step, ...],
    provenance: Provenance,
    *,
    title: str,
    trials: Trials,
    frames: Frames = (),
    opening: Sequence[Section] = (),
    atlas: Sequence[Section] = (),
) -> Page:
    """The page of ``discover``: verdict, figures, candidates, next trials.

    ``opening`` sections precede the figures, ``atlas`` sections follow them.
    """
    verdict = discovery.verdict
    cells = discovery.cells
    return Page(
        title=title,
        kind="Where the walking model fails, and what repairs it",
        status=verdict.status,
        sentence=_sentence(verdict.because, steps, discovery.noise_floor_m_s),
        headline=headline(steps, discovery.noise_floor_m_s, provenance, cells),
        cautions=provenance.cautions,
        steps=_step_names(steps),
        sections=(
            *opening,
            *figure_sections(steps, discovery.noise_floor_m_s),
            *run_order_section(trials, steps),
            *atlas,
            *tables.candidates(discovery),
            *tables.limits(discovery),
            *tables.residual(discovery),
            tables.parameters(steps),
            *tables.next_trials(discovery),
            tables.failing(steps),
            *tables.video(frames),
            data(steps, provenance, [json_download(discovery)]),
        ),
    )


def comparison_page(
    steps: tuple[Step, ...],
    provenance: Provenance,
    *,
    title: str,
    frames: Frames = (),
    opening: Sequence[Section] = (),
    atlas: Sequence[Section] = (),
) -> Page:
    """The page of ``compare``: the fits in the given order, without a verdict; otherwise as in ``discovery_page``."""
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
            *opening,
            *figure_sections(steps, floor),
            *atlas,
            tables.parameters(steps),
            tables.failing(steps),
            *tables.video(frames),
            data(steps, provenance, []),
        ),
    )


def headline(
    steps: tuple[Step, ...], noise_floor_m_s: float, provenance: Provenance, cells: Cells
) -> tuple[tuple[str, str, str], ...]:
    """The key numbers at the top: (term, value, meaning)."""
    first, last = steps[0].fit, steps[-1].fit
    terms = [(f"Error, {steps[0].label}", text.cm_s(first.rmse_m_s), _out_of_sample(first))]
    if len(steps) > 1:
        terms.append((f"Error, {steps[-1].label}", text.cm_s(last.rmse_m_s), _out_of_sample(last)))
    meaning = (
        "r.m.s. of the error bars of mean speed" if cells.error_bars else "scatter of mean speed between replicates"
    )
    terms.append(("Noise floor", text.cm_s(noise_floor_m_s), meaning))
    levels, omegas = len(cells.level_phi), len(frequencies(cells)[0])
    plan = f"{len(cells)} conditions over {levels} φ and {omegas} ω"
    terms.append(("Trials", str(provenance.used), plan))
    return tuple(terms)


def _out_of_sample(fit: Fit) -> str:
    return f"r.m.s. of mean speed; {fit.out_of_sample}"


def _sentence(because: str, steps: tuple[Step, ...], floor: float) -> str:
    """The reason for the verdict, and the resulting change of the error."""
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
