"""The page's parts: what stands where, with a name for each control. No fit and no figure is made here."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dash import dcc, html

from sandbot_common.errors import InputError
from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.discover import Discovery
from sandbot_model.explore.helpful import Preview, change_of, helps
from sandbot_model.explore.views import TITLES, Pane, Slider, values
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.symbols import listed
from sandbot_model.physics.typeset import mathml_in_pieces
from sandbot_model.physics.walking import BASES
from sandbot_model.report import text
from sandbot_model.report.captions import HOW
from sandbot_model.report.drawings import drawing
from sandbot_model.report.page import data_uri
from sandbot_model.report.theme import Spec
from sandbot_model.report.view import Provenance, Step, bands, observable_label, readable

GRAPH = {
    "displaylogo": False,
    "responsive": True,
    "modeBarButtons": [["zoom2d", "pan2d", "resetScale2d"]],
}
FORMATS = ("svg", "png", "csv")
MAX_EXCLUDED = 60
FORMULA_EXAMPLE = "boost: strength: k*(1 + a*(phi - 0.6)); a [1] in -5..5"


def page(title: str, data_line: str, provenance: Provenance, cells: Cells, floor_m_s: float) -> html.Div:
    """The whole page, controls first in reading order, figures next to them."""
    return html.Div(
        [
            dcc.Location(id="address", refresh=False),
            dcc.Store(id="theme", data=None),
            dcc.Store(id="shown"),
            dcc.Store(id="undone"),
            dcc.Interval(id="preview-clock", interval=1000),
            dcc.Interval(id="suggest-clock", interval=500, disabled=True),
            dcc.Download(id="download"),
            html.A("Skip to the figures", href="#figures", className="skip"),
            html.Header(
                [
                    html.H1(title),
                    html.P(data_line, className="soft"),
                    html.P(id="status", role="status", className="status"),
                    html.P(id="message", role="alert", className="message"),
                    *(_caution(*caution) for caution in provenance.cautions),
                    *_excluded(provenance),
                ]
            ),
            html.Div([_controls(floor_m_s), _figures(cells)], className="columns"),
        ],
        className="page",
    )


def _caution(kind: str, line: str) -> html.P:
    return html.P([html.Strong(f"{kind} "), line], className="caution")


def _excluded(provenance: Provenance) -> list[html.Details]:
    """Which trials were excluded, folded."""
    if not provenance.excluded:
        return []
    rows = provenance.excluded[:MAX_EXCLUDED]
    more = [] if len(rows) == len(provenance.excluded) else [html.P(f"and {len(provenance.excluded) - len(rows)} more")]
    head = html.Summary(f"{len(provenance.excluded)} trials excluded, and why")
    return [html.Details([head, _table("Trials excluded", ("trial", "why"), rows), *more], id="excluded")]


def effect_options(
    effects: Mapping[str, Effect], order: Sequence[str], current: Step, previews: Mapping[str, Preview]
) -> list[dict[str, Any]]:
    """One option for each effect in ``order``: drawing, name, error before → after it is switched on, stage, formula,
    and fitted values if it is on; what does not help is marked as such, for the page to fold.
    """
    on, now = current.fit.effects, current.fit.rmse_m_s
    options = []
    for name in order:
        effect, preview = effects[name], previews[name]
        useful = name in on or helps(preview, now)
        label = html.Span(
            [
                html.Img(src=f"/drawing/{name}.svg", alt="", className="drawing") if drawing(name) else None,
                html.Span(readable(name), className="effect"),
                html.Span(change_of(preview, name in on, now), className="preview"),
                html.Small([f"{effect.stage}: ", _typeset(effect.formula)]),
                *([html.Small(values(effect, current), className="values")] if name in on else []),
            ],
            className="effect-line" if useful else "effect-line useless",
        )
        options.append({"value": name, "label": label, "title": effect.seen_in})
    return options


def formula_read(typed: str) -> list[Any]:
    """How a formula is understood while it is typed: set as mathematics, or what is wrong with it."""
    if not typed.strip():
        return []
    try:
        effect = formula_effect(typed)
    except InputError as error:
        return [str(error).partition(f"{typed!r}: ")[2] or str(error)]
    ranges = (
        f"{p.name} from {p.low:g} to {p.high:g}{'' if p.unit == '1' else f' {p.unit}'}" for p in effect.parameters
    )
    return [_typeset(effect.formula), html.Br(), html.Small("; ".join(ranges))]


def _symbols() -> html.Table:
    """All symbols; a press on one puts it into the formula (explore.js)."""
    rows = [
        (
            [html.Button(name, type="button", **{"data-symbol": name}) for name in one.spellings[:1]],
            one.unit, one.stage, one.doc,
        )
        for one in listed()
    ]  # fmt: skip
    return _table("Quantities of the chain, in its order", ("symbol", "unit", "from stage", "meaning"), rows)


def _typeset(formula: str) -> html.Span:
    """A formula as MathML: Dash has no such element, so explore.js puts it there."""
    return html.Span(title=formula, className="formula", **{"data-mathml": mathml_in_pieces(formula)})


def by_hand(sliders: Sequence[Slider]) -> list[Any]:
    """A labelled slider for each parameter of the model shown."""
    return [
        html.Div(
            [
                html.Label([slider.words, html.Strong(" held" if slider.held else "")]),
                dcc.Slider(
                    slider.low,
                    slider.high,
                    value=slider.value,
                    step=(slider.high - slider.low) / 400 or None,
                    marks=None,
                    updatemode="mouseup",
                    tooltip={"placement": "bottom"},
                    id={"by_hand": slider.name.replace(".", "/")},
                ),
            ],
            className="slider",
        )
        for slider in sliders
    ]


def parameter_table(rows: Sequence[tuple[str, str, str]]) -> html.Table:
    """Fitted values with errors and units."""
    return _table("Fitted values ± standard error", ("parameter", "value", "unit"), rows)


def trial_table(rows: Sequence[Sequence[Any]], head: Sequence[str]) -> html.Table:
    """The trials of one cell."""
    return _table("Trials of this condition", head, rows)


def plot(name: str, spec: Spec | None = None, how_to_read: str = "", caption: str = "") -> html.Figure:
    """A figure with how to read it, what it shows in words, and buttons that save it."""
    given = {"figure": spec, "style": height(spec)} if spec else {}
    graph = dcc.Graph(id=name, config=GRAPH, **given)
    buttons = [
        html.Button(
            file_format.upper(),
            type="button",
            **{
                "data-format": file_format,
                "data-figure": name,
                "aria-label": f"Save figure {name} as {file_format.upper()}",
            },
        )
        for file_format in FORMATS
    ]
    return html.Figure(
        [
            html.Div(graph, className="plot", id=f"{name}-box", role="group", **{"aria-labelledby": f"{name}-says"}),
            html.Figcaption(
                [
                    html.P(how_to_read, id=f"{name}-how"),
                    html.P(caption, id=f"{name}-says"),
                    html.P(["Save figure: ", *buttons], className="save"),
                ]
            ),
        ]
    )


def height(spec: Spec) -> dict[str, str]:
    """The style of a graph that shows ``spec``: a graph that adapts its width takes its height from there."""
    return {"height": f"{spec['layout']['height']}px"}


def panes(shown: Sequence[Pane]) -> list[Any]:
    """Figures beside the first one."""
    parts = []
    for i, pane in enumerate(shown):
        body = html.P(pane.caption) if pane.figure is None else plot(f"beside-{i}", pane.figure, caption=pane.caption)
        parts.append(html.Section([html.H2(pane.title), body], className="pane"))
    return parts


def film(strip: Sequence[tuple[bytes, str]]) -> html.Div:
    """Frames of the lateral camera with the tracked marks drawn on them."""
    frames = [
        html.Figure([html.Img(src=data_uri(jpeg, "image/jpeg"), alt=caption), html.Figcaption(caption)])
        for jpeg, caption in strip
    ]
    return html.Div(frames, className="film")


def suggestion(found: Discovery, why: str = "/why") -> list[Any]:
    """Verdict, candidates and next trials of a discovery; ``why`` is the address of its argument."""
    verdict = found.verdict
    named = " + ".join(map(readable, verdict.effects))
    if verdict.status == "ambiguous":
        named = f"one of {len(verdict.alternatives)} sets of effects, these data can't tell which"
    because = verdict.because[:1].upper() + verdict.because[1:]
    parts: list[Any] = [
        html.P([html.Strong(f"{verdict.status.capitalize()}{f': {named}' if named else ''}. "), because]),
        html.P(html.A("Why: the argument, the rivals and the plan of the next trials", href=why)),
        _table(
            "Best single effects",
            ("effect", "ΔBIC", "out of sample"),
            [(readable(c.effect), text.number(c.delta_bic), text.cm_s(c.cv_rmse_m_s)) for c in found.candidates[:5]],
        ),
    ]
    if found.residual is not None:
        residual = found.residual
        parts.append(
            html.P([f"Residual: {residual.sentence}. To try as your own effect: ", html.Code(residual.formula)])
        )
    if found.next_trials:
        rows = [(t.where, observable_label(t.observable), _gap(t.expected_gap_sd)) for t in found.next_trials]
        parts.append(_table("Next trials", ("at", "watch", "expected gap"), rows))
    return parts


def progress(stage: str, done: int, total: int) -> list[Any]:
    """How far a discovery is."""
    return [html.Label(f"Trying {stage}: {done} of {total}"), html.Progress(value=str(done), max=str(max(total, 1)))]


def _floor(floor_m_s: float) -> str:
    return f"; noise floor {text.cm_s(floor_m_s)}" if math.isfinite(floor_m_s) else ""


def _controls(floor_m_s: float) -> html.Section:
    # No form: Enter in the formula would send it and leave the page.
    return html.Section(
        [
            html.Fieldset(
                [
                    html.Legend("Base model"),
                    dcc.RadioItems(list(BASES), "simple", id="model", inline=True),
                ]
            ),
            html.Div(
                [
                    html.Button(
                        "Suggest", id="suggest", type="button", n_clicks=0, title="run discovery on these trials"
                    ),
                    html.Button("Undo", id="undo", type="button", n_clicks=0),
                    html.Button("Save YAML", id="save", type="button", n_clicks=0),
                    html.Button("Save CSV", id="save-csv", type="button", n_clicks=0),
                ],
                className="buttons",
            ),
            html.Div(
                [
                    html.Div(id="suggestion", role="status"),
                    html.Button("Switch these on", id="adopt", type="button", n_clicks=0, hidden=True),
                ]
            ),
            html.Fieldset(
                [
                    html.Legend(f"Effects, and the error of mean speed without → with each{_floor(floor_m_s)}"),
                    html.Div(dcc.Checklist([], [], id="effects", className="effects"), id="effects-box"),
                    html.Div(
                        [
                            html.Button("Show all effects", id="unfold", type="button", **{"aria-pressed": "false"}),
                            html.A("As cards", id="cards", href="/effects", title="what each effect is"),
                        ],
                        className="buttons below",
                    ),
                ]
            ),
            html.Details(
                [
                    html.Summary("Your own effect"),
                    html.Label("name: stage: formula; parameter [unit] in low..high", htmlFor="formula"),
                    dcc.Input(id="formula", type="text", placeholder=FORMULA_EXAMPLE, debounce=False, n_submit=0),
                    html.Button("Add and fit", id="add", type="button", n_clicks=0),
                    html.P(id="formula-read", className="formula-read", role="status"),
                    html.Details([html.Summary("Symbols a formula may hold"), _symbols()]),
                ]
            ),
        ],
        className="controls",
        **{"aria-label": "Model and effects"},
    )


def _figures(cells: Cells) -> html.Main:
    labels = _cell_labels(cells)
    return html.Main(
        [
            html.Div(
                [
                    dcc.RadioItems(
                        [{"value": view, "label": title} for view, title in TITLES.items()],
                        "speed", id="view", inline=True, className="tabs",
                    ),
                    html.A("Why", id="why", href="/why", title="the argument for the verdict on these trials"),
                    html.A("Atlas", id="atlas", href="/atlas", title="the figures of Li et al. 2009 from these trials"),
                ],
                className="tab-row",
            ),
            html.Div(
                dcc.RadioItems(
                    [{"value": observable.name, "label": observable.heading} for observable in Observable],
                    "speed", id="observable", inline=True, className="tabs small",
                ),
                id="observable-row",
            ),
            html.Div(
                [
                    html.Section([html.H2(id="pane-title", hidden=True), plot("figure")], className="pane"),
                    html.Div(id="beside", className="panes"),
                ],
                className="panes",
            ),
            html.Div(
                [
                    html.Button("Keep as second model", id="pin", type="button", n_clicks=0),
                    html.Button("Remove the second model", id="unpin", type="button", n_clicks=0, hidden=True),
                ],
                className="buttons",
            ),
            html.Div(
                [
                    html.H2("Values by hand"),
                    html.P("Move a value to see what it does; k(φ) stays as fitted.", className="soft"),
                    html.Div(id="by-hand"),
                    html.Button("Refit all", id="release", type="button", n_clicks=0),
                    html.Div(id="parameters"),
                ],
                id="parameters-box",
                hidden=True,
            ),
            html.H2("Error as effects are added"),
            plot("ladder", how_to_read=HOW["ladder"]),
            html.H2("Trials behind a point"),
            html.Label("Click a point or a cell of the map, or choose a condition", htmlFor="cell"),
            dcc.Dropdown(
                [{"value": i, "label": label} for i, label in enumerate(labels)], None, id="cell", clearable=True
            ),
            html.Div(id="trials", role="region", tabIndex=0, **{"aria-label": "Trials of the condition chosen"}),
        ],
        id="figures",
        tabIndex=-1,
    )  # fmt: skip


def _cell_labels(cells: Cells) -> list[str]:
    labels = [""] * len(cells)
    for band in bands(cells):
        for i in band.cells:
            labels[int(i)] = f"{band.label}, ω {cells.omega[i]:.4g} rad/s"
    return labels


def _table(caption: str, head: Sequence[str], rows: Sequence[Sequence[Any]]) -> html.Table:
    return html.Table(
        [
            html.Caption(caption),
            html.Thead(html.Tr([html.Th(words, scope="col") for words in head])),
            html.Tbody([html.Tr([html.Td(cell) for cell in row]) for row in rows]),
        ]
    )


def _gap(expected_sd: float) -> str:
    """The gap a trial is to show; none where it is to show the scatter itself."""
    return f"{expected_sd:.1f} s.d." if math.isfinite(expected_sd) else "scatter"
