"""The explorer's callbacks: their inputs, their outputs, and the functions that answer."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from dash import ALL, Dash, Input, Output, State

from sandbot_model.explore import effect_list
from sandbot_model.explore.actions import CONTROLS
from sandbot_model.report.page import source

INDEX = """<!doctype html>
<html lang="en">
<head>
{%metas%}
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{%title%}</title>
{%favicon%}
{%css%}
</head>
<body>
{%app_entry%}
<footer>{%config%}{%scripts%}{%renderer%}<script>{export}</script></footer>
</body>
</html>"""
SHOWN = (
    "effects.options",
    "preview-clock.disabled",
    "atlas.href",
    "cards.href",
    "why.href",
    "observable-row.hidden",
    "parameters-box.hidden",
    "by-hand.children",
    "figure.figure",
    "figure.style",
    "figure-how.children",
    "figure-says.children",
    "pane-title.children",
    "pane-title.hidden",
    "unpin.hidden",
    "ladder.figure",
    "ladder.style",
    "ladder-says.children",
    "parameters.children",
    "beside.children",
    "trials.children",
    "status.children",
    "message.children",
)
"""Outputs that follow from the address, as component.property."""


def bare(title: str, on_error: Callable[[Exception], None]) -> Dash:
    """The application without its content; nothing is loaded from the network."""
    return Dash(
        "sandbot_explorer",
        title=title,
        update_title="",
        assets_folder=str(Path(__file__).parent / "assets"),
        serve_locally=True,
        suppress_callback_exceptions=True,
        on_error=on_error,
        index_string=INDEX.replace("{export}", source("export.js")),
    )


def wire(app: Dash, answers: Any) -> None:
    """Register all callbacks: the methods ``on_…`` of ``answers``, an ``Explorer``, each run in a server thread."""
    _wire_page(app, answers)
    _wire_controls(app, answers)
    _wire_suggestion(app, answers)
    _wire_clientside(app)


def _wire_page(app: Dash, answers: Any) -> None:
    app.callback(
        output=_outputs(*SHOWN),
        inputs={"search": Input("address", "search"), "theme": Input("theme", "data")},
        state={"sliders": State({"by_hand": ALL}, "value"), "slider_ids": State({"by_hand": ALL}, "id")},
    )(answers.on_address)
    app.callback(
        output=_outputs("effects.options", "preview-clock.disabled", allow_duplicate=True),
        inputs={"_tick": Input("preview-clock", "n_intervals")},
        # From the address, not from the page shown: with slow figures, effects of an earlier page would overwrite it.
        state={"search": State("address", "search")},
        prevent_initial_call=True,
    )(answers.on_preview_clock)
    app.callback(Output("formula-read", "children"), Input("formula", "value"), prevent_initial_call=True)(
        lambda typed: effect_list.formula_read(typed or "")
    )


def _wire_controls(app: Dash, answers: Any) -> None:
    # Controls set the address and the page shown sets the controls, all by set_props. With Outputs, Dash would see a
    # circular dependency, delay a control until the previous figures have arrived, and then reset it.
    app.callback(
        inputs={
            "values": {name: Input(name, "value") for name in CONTROLS},
            "_clicks": [
                Input("figure", "clickData"),
                *(Input(name, "n_clicks") for name in ("add", "release", "adopt", "pin", "unpin")),
                Input("formula", "n_submit"),
            ],
            "sliders": Input({"by_hand": ALL}, "value"),
            "_recheck": Input("recheck", "data"),
        },
        state={
            "slider_ids": State({"by_hand": ALL}, "id"),
            "formula": State("formula", "value"),
            "search": State("address", "search"),
            "shown": State("shown", "data"),
            "reported": State("reported", "data"),
        },
        prevent_initial_call=True,
    )(answers.on_control)
    app.callback(
        Output("download", "data"),
        Input("save", "n_clicks"),
        Input("save-csv", "n_clicks"),
        State("address", "search"),
        prevent_initial_call=True,
    )(answers.on_save)


def _wire_suggestion(app: Dash, answers: Any) -> None:
    app.callback(
        output=_outputs("suggestion.children", "suggest-clock.disabled", "adopt.hidden", "asked.data"),
        inputs={
            "_clicks": Input("suggest", "n_clicks"),
            "_tick": Input("suggest-clock", "n_intervals"),
            # A suggestion for another base model is removed.
            "search": Input("address", "search"),
        },
        state={"asked": State("asked", "data")},
        prevent_initial_call=True,
    )(answers.on_suggest)


def _wire_clientside(app: Dash) -> None:
    app.clientside_callback(
        "window.dash_clientside.explore.settle",
        Input("shown", "data"),
        Input("reported", "data"),
        Input("address", "search"),
        *(State(name, "value") for name in CONTROLS),
        prevent_initial_call=True,
    )
    app.clientside_callback(
        "window.dash_clientside.explore.theme", Output("theme", "data"), Input("address", "pathname")
    )
    app.clientside_callback(
        "window.dash_clientside.explore.undo",
        Output("undone", "data"),
        Input("undo", "n_clicks"),
        prevent_initial_call=True,
    )


def _outputs(*names: str, allow_duplicate: bool = False) -> dict[str, Output]:
    """The outputs of a callback by component.property."""
    return {name: Output(*name.split("."), allow_duplicate=allow_duplicate) for name in names}
