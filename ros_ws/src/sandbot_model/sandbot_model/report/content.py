"""Assembles the page from fits and discovery: text, tables, and the order of the figures."""

from collections.abc import Sequence

from sandbot_model.data.conditions import Cells, noise_floor
from sandbot_model.discovery.result import Discovery
from sandbot_model.fitting.fit import Fit
from sandbot_model.report import table_sections as tables
from sandbot_model.report import text
from sandbot_model.report.data_section import data, json_download
from sandbot_model.report.drawings import drawing
from sandbot_model.report.effect_facts import words
from sandbot_model.report.figure_sections import figure_sections, run_order_section
from sandbot_model.report.in_words import estimates, in_three_sentences, named_sets, spelled_out
from sandbot_model.report.page import NamedEffect, Page, Section, data_uri
from sandbot_model.report.table_sections import Frames
from sandbot_model.report.view import Provenance, Step, frequencies, is_ladder, readable
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
        sentence=in_three_sentences(discovery, trials.robot),
        why=_why(discovery, steps),
        named=_named(discovery),
        headline=headline(steps, discovery.noise_floor_m_s, provenance, cells),
        cautions=provenance.cautions,
        steps=_step_names(steps),
        opened=-1 if is_ladder(steps) else 1,
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
            *tables.failing(steps),
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
            *tables.failing(steps),
            *tables.video(frames),
            data(steps, provenance, []),
        ),
    )


def headline(
    steps: tuple[Step, ...], noise_floor_m_s: float, provenance: Provenance, cells: Cells
) -> tuple[tuple[str, str, str], ...]:
    """The key numbers at the top: (term, value, meaning)."""
    first = steps[0].fit
    terms = [(f"Error, {steps[0].label}", text.cm_s(first.rmse_m_s), _out_of_sample(first))]
    for step in steps[-1:] if is_ladder(steps) else steps[1:]:
        if step is not steps[0]:
            terms.append((f"Error, {step.label}", text.cm_s(step.fit.rmse_m_s), _out_of_sample(step.fit)))
    meaning = (
        "r.m.s. of the error bars of mean speed" if cells.error_bars else "scatter of mean speed between replicates"
    )
    terms.append(("Noise floor", text.cm_s(noise_floor_m_s), meaning))
    levels, omegas = len(cells.level_phi), len(frequencies(cells)[0])
    plan = f"{text.counted(len(cells), 'condition')} over {levels} φ and {omegas} ω"
    terms.append(("Trials", str(provenance.used), plan))
    return tuple(terms)


def _out_of_sample(fit: Fit) -> str:
    return f"r.m.s. of mean speed; {fit.out_of_sample}"


def _why(found: Discovery, steps: tuple[Step, ...]) -> str:
    """The reason for the verdict, with its numbers, and the resulting change of the error."""
    reason = spelled_out(found.verdict.because, found.fit.model.catalogue).rstrip(".")
    return f"{reason[:1].upper()}{reason[1:]}. {_comparison_sentence(steps, found.noise_floor_m_s)}"


def _named(found: Discovery) -> tuple[tuple[str, tuple[NamedEffect, ...]], ...]:
    """The sets that the verdict names, with a heading where it can't tell which of several holds."""
    sets = named_sets(found)
    either = ("Either ", *["Or "] * (len(sets) - 1)) if len(sets) > 1 else ("",)
    return tuple(_named_set(which, names, found, fit) for which, (names, fit) in zip(either, sets, strict=False))


def _named_set(
    which: str, names: tuple[str, ...], found: Discovery, fit: Fit | None
) -> tuple[str, tuple[NamedEffect, ...]]:
    """The heading of one of several sets, which a single effect has itself, and the effects of the set."""
    heading = f"{which}{' + '.join(map(readable, names))}" if which and len(names) > 1 else ""
    return heading, tuple(_named_effect(name, "" if heading else which, found, fit) for name in names)


def _named_effect(name: str, which: str, found: Discovery, fit: Fit | None) -> NamedEffect:
    drawn = drawing(name)
    fitted = () if fit is None else estimates(name, fit)
    return NamedEffect(
        f"{which}{readable(name)}",
        words(found.fit.model.catalogue[name]),
        tuple(f"{p.doc}: {value}{remark}" for p, value, remark in fitted),
        data_uri(drawn.encode(), "image/svg+xml") if drawn else "",
    )


def _comparison_sentence(steps: tuple[Step, ...], floor: float) -> str:
    first, last = steps[0], steps[-1]
    if last.fit.undetermined:
        return f"The {last.whole_label} can't be tested: {last.fit.undetermined}."
    if len(steps) == 1:
        return (
            f"The {first.label} leaves {text.cm_s(first.fit.rmse_m_s)} of error; the noise floor is {text.cm_s(floor)}."
        )
    if not is_ladder(steps):
        errors = sorted({text.cm_s(step.fit.rmse_m_s) for step in steps[1:]})
        return (
            f"With any of them the error of mean speed goes from {text.cm_s(first.fit.rmse_m_s)} to "
            f"{' or '.join(errors)}; the noise floor is {text.cm_s(floor)}."
        )
    change = "falls" if last.fit.rmse_m_s < first.fit.rmse_m_s else "does not fall:"
    return (
        f"With {last.label.removeprefix('+ ')} the error of mean speed {change} from {text.cm_s(first.fit.rmse_m_s)} "
        f"to {text.cm_s(last.fit.rmse_m_s)}; the noise floor is {text.cm_s(floor)}."
    )


def _step_names(steps: tuple[Step, ...]) -> tuple[tuple[str, str], ...]:
    return tuple((step.label, f"error {text.cm_s(step.fit.rmse_m_s)}") for step in steps)
