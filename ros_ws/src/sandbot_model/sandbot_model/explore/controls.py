"""The layout of the explorer's page, with the id of each control. No fit and no figure is computed here."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dash import dcc, html

from sandbot_model.data.conditions import Cells
from sandbot_model.discovery.selection import Selection, cell_text
from sandbot_model.explore.actions import values_of
from sandbot_model.explore.blocks import plot, table
from sandbot_model.explore.condition import condition_of
from sandbot_model.explore.effect_list import symbols
from sandbot_model.explore.static_html import static
from sandbot_model.explore.views import TITLES, Slider
from sandbot_model.fitting.text import NO_ERROR
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.walking import BASES
from sandbot_model.report import text
from sandbot_model.report.captions import how_to_read
from sandbot_model.report.view import Provenance, bands

MAX_EXCLUDED = 60
FORMULA_EXAMPLE = "boost: strength: k*(1 + a*(omega/12 - 1)); a [1] in -1..1"


def page(title: str, data_line: str, provenance: Provenance, cells: Cells, floor_m_s: float) -> html.Div:
    """The whole page, controls first in reading order, figures next to them."""
    return html.Div(
        [
            dcc.Location(id="address", refresh=False),
            dcc.Store(id="theme", data=None),
            dcc.Store(id="shown"),
            dcc.Store(id="reported", data=values_of(Selection(), cells)),
            dcc.Store(id="recheck"),
            dcc.Store(id="undone"),
            dcc.Store(id="asked"),
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
                    *(
                        html.P([html.Strong(f"{kind} "), line], className="caution")
                        for kind, line in provenance.cautions
                    ),
                    *_excluded(provenance),
                ]
            ),
            html.Div([_controls(floor_m_s), _figures(cells)], className="columns"),
        ],
        className="page",
    )


def _excluded(provenance: Provenance) -> list[html.Details]:
    """The excluded trials with reasons, folded."""
    if not provenance.excluded:
        return []
    rows = provenance.excluded[:MAX_EXCLUDED]
    more = [] if len(rows) == len(provenance.excluded) else [html.P(f"and {len(provenance.excluded) - len(rows)} more")]
    head = html.Summary(f"{len(provenance.excluded)} trials excluded, and why")
    listed = static(table("Trials excluded", ("trial", "why"), rows), *more)
    return [html.Details([head, listed], id="excluded")]


def by_hand(sliders: Sequence[Slider]) -> list[Any]:
    """A labelled slider for each parameter of the model shown."""
    return [
        html.Div(
            [
                html.Label([slider.words, html.Strong(" held", id=held_id(slider.name), hidden=not slider.held)]),
                dcc.Slider(
                    slider.low,
                    slider.high,
                    value=slider.value,
                    step=(slider.high - slider.low) / 400 or None,
                    marks=None,
                    updatemode="mouseup",
                    tooltip={"placement": "bottom"},
                    id={"by_hand": _key(slider.name)},
                ),
            ],
            className="slider",
        )
        for slider in sliders
    ]


def held_id(name: str) -> dict[str, str]:
    """The id of the word that marks a parameter as held by hand."""
    return {"held": _key(name)}


def slider_values(ids: Sequence[Mapping[str, str]], values: Sequence[float]) -> dict[str, float]:
    """Current values of the sliders, by parameter."""
    return {slider["by_hand"].replace("/", "."): value for slider, value in zip(ids, values, strict=True)}


def _key(name: str) -> str:
    # Dash allows no full stop in an id.
    return name.replace(".", "/")


def parameter_table(rows: Sequence[tuple[str, str, str]]) -> html.Table:
    """Fitted values with errors and units."""
    return table(f"Fitted values ± standard error; {NO_ERROR}", ("parameter", "value", "unit"), rows)


def _controls(floor_m_s: float) -> html.Section:
    choices = dcc.RadioItems(list(BASES), "simple", id="model", inline=True)
    base_model = html.Fieldset([html.Legend("Base model"), choices])
    # Not a form: Enter in the formula would submit it and leave the page.
    return html.Section(
        [base_model, _buttons(), _suggestion(), _effects(floor_m_s), _own_effect()],
        className="controls",
        **{"aria-label": "Model and effects"},
    )


def _buttons() -> html.Div:
    return html.Div(
        [
            _button("suggest", "Suggest", title="run discovery on these trials"),
            _button("undo", "Undo"),
            _button("save", "Save YAML"),
            _button("save-csv", "Save CSV"),
        ],
        className="buttons",
    )


def _suggestion() -> html.Div:
    return html.Div([html.Div(id="suggestion", role="status"), _button("adopt", "Switch these on", hidden=True)])


def _effects(floor_m_s: float) -> html.Fieldset:
    floor = f"; noise floor {text.cm_s(floor_m_s)}" if math.isfinite(floor_m_s) else ""
    return html.Fieldset(
        [
            html.Legend("Effects"),
            html.P(f"Error of mean speed without → with each; sorted by ΔBIC{floor}", className="soft"),
            html.Div(dcc.Checklist([], [], id="effects", className="effects"), id="effects-box"),
            html.Div(
                [
                    html.Button("Show all effects", id="unfold", type="button", **{"aria-pressed": "false"}),
                    html.A("As cards", id="cards", href="/effects", title="what each effect is"),
                ],
                className="buttons below",
            ),
        ]
    )


def _own_effect() -> html.Details:
    return html.Details(
        [
            html.Summary("Your own effect"),
            html.Label("name: stage: formula; parameter [unit] in low..high", htmlFor="formula"),
            dcc.Input(id="formula", type="text", placeholder=FORMULA_EXAMPLE, debounce=False, n_submit=0),
            _button("add", "Add and fit"),
            html.P(id="formula-read", className="formula-read", role="status"),
            html.Details([html.Summary("Symbols that a formula may contain"), symbols()]),
        ]
    )


def _figures(cells: Cells) -> html.Main:
    return html.Main(
        [
            *_tabs(),
            _panes(),
            html.Div(
                [_button("pin", "Keep as second model"), _button("unpin", "Remove the second model", hidden=True)],
                className="buttons",
            ),
            _values_by_hand(),
            html.H2("Error as effects are added"),
            plot("ladder", how_to_read=how_to_read("ladder", cells)),
            *_trials_behind_a_point(cells),
        ],
        id="figures",
        tabIndex=-1,
    )


def _tabs() -> list[html.Div]:
    """The views and pages, and the observables of a view."""
    views = [{"value": view, "label": title} for view, title in TITLES.items()]
    observables = [{"value": observable.name, "label": observable.heading} for observable in Observable]
    return [
        html.Div(
            [
                dcc.RadioItems(views, "speed", id="view", inline=True, className="tabs"),
                html.Nav(
                    [
                        html.A("Why", id="why", href="/why", title="the argument for the verdict on these trials"),
                        html.A(
                            "Atlas", id="atlas", href="/atlas", title="the figures of Li et al. 2009 from these trials"
                        ),
                    ]
                ),
            ],
            className="tab-row",
        ),
        html.Div(
            dcc.RadioItems(observables, "speed", id="observable", inline=True, className="tabs small"),
            id="observable-row",
        ),
    ]


def _panes() -> html.Div:
    """The figure, and that of a second model beside it."""
    return html.Div(
        [
            html.Section([html.H2(id="pane-title", hidden=True), plot("figure")], className="pane"),
            html.Div(id="beside", className="panes"),
        ],
        className="panes",
    )


def _values_by_hand() -> html.Div:
    return html.Div(
        [
            html.H2("Values by hand"),
            html.P("Move a value to see what it does; k(φ) stays as fitted.", className="soft"),
            html.Div(id="by-hand"),
            _button("release", "Refit all"),
            html.Div(id="parameters"),
        ],
        id="parameters-box",
        hidden=True,
    )


def _trials_behind_a_point(cells: Cells) -> list[Any]:
    conditions = [
        {"value": cell_text(condition_of(cells, i)), "label": label} for i, label in enumerate(_cell_labels(cells))
    ]
    return [
        html.H2("Trials behind a point"),
        html.Label("Click a point or a cell of the map, or choose a condition", htmlFor="cell"),
        dcc.Dropdown(conditions, None, id="cell", clearable=True),
        html.Div(id="trials", role="region", tabIndex=0, **{"aria-label": "Trials of the condition chosen"}),
    ]


def _button(identifier: str, label: str, **more: Any) -> html.Button:
    return html.Button(label, id=identifier, type="button", n_clicks=0, **more)


def _cell_labels(cells: Cells) -> list[str]:
    labels = [""] * len(cells)
    for band in bands(cells):
        for i in band.cells:
            labels[int(i)] = f"{band.label}, ω {cells.omega[i]:.4g} rad/s"
    return labels
