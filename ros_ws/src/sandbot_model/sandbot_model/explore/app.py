"""The application: the callbacks of the page (``wiring``). It serves this host only.

The address holds the state: every control changes it and everything shown follows from it, so the browser's "back" is
undo and a page can be bookmarked or shared. The two are separate steps: changing the address needs no fit, so a control
used while figures are still being computed (they are then dropped) adds to the previous change.
"""

import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dash import Dash, ctx, html, no_update, set_props
from dash.exceptions import PreventUpdate
from flask import Response, abort, send_file

from sandbot_common.errors import InputError
from sandbot_model.discovery.reproduce import steps_of
from sandbot_model.discovery.selection import Selection, from_query, to_query, to_yaml
from sandbot_model.explore import blocks, cell_trials, condition, controls, effect_list, suggestion, views
from sandbot_model.explore.actions import (
    act,
    can_adopt,
    clicked_option,
    values_of,
    with_controls,
    with_sliders,
    with_verdict,
)
from sandbot_model.explore.atlas_page import AtlasPage
from sandbot_model.explore.cards_page import CardsPage
from sandbot_model.explore.job import Job, question_of
from sandbot_model.explore.loopback import own_host_only
from sandbot_model.explore.pages import serve
from sandbot_model.explore.session import Session
from sandbot_model.explore.trial_page import TrialPage
from sandbot_model.explore.why_page import WhyPage
from sandbot_model.explore.wiring import SHOWN, bare, wire
from sandbot_model.fitting.text import counted
from sandbot_model.report import waveforms
from sandbot_model.report.data_section import cells_csv
from sandbot_model.report.provenance import bags_of, lost_bags, provenance
from sandbot_model.report.theme import LIGHT, THEMES, Spec, Theme
from sandbot_record.trials.table import Trials


@dataclass(frozen=True)
class Beside:
    """A second data set, shown with the same selection: of another lab, or earlier trials."""

    session: Session
    title: str


class Explorer:
    """The page of one data set, with an optional second one beside it."""

    def __init__(
        self, session: Session, trials: Trials, data: Sequence[Path], title: str,
        beside: Beside | None = None, options: Sequence[str] = (), robot_line: str = "",
    ) -> None:  # fmt: skip
        """``options`` are command-line arguments that ``compare`` needs to reproduce the fits (see ``to_yaml``).

        ``robot_line`` states where the robot's dimensions come from.
        """
        self.session, self.trials, self.data, self.title = session, trials, tuple(data), title
        self.beside, self.options, self.robot_line = beside, tuple(options), robot_line
        self.bags = bags_of([path for path in data if path.exists()])
        self.provenance = provenance(trials, session.cells, lost_bags(self.bags, trials))
        self.job = Job(session)

    def app(self) -> Dash:
        """The Dash application; nothing is loaded from the network."""
        cells, provenance = self.session.cells, self.provenance
        line = (
            f"{counted(provenance.used, 'trial')} used, {len(provenance.excluded)} excluded; "
            f"{counted(len(cells), 'condition')} over {counted(len(cells.level_phi), 'volume fraction')}"
        )
        line += f"; {self.robot_line}" if self.robot_line else ""
        app = bare(self.title, _on_error)
        own_host_only(app.server)
        app.layout = controls.page(self.title, line, provenance, cells, self.session.noise_floor_m_s)
        serve(
            app.server,
            {"/bag/<trial_id>/<name>": self.send_bag},
            AtlasPage(self.session, self.trials, self.bags, self.title).routes,
            CardsPage(self.session, self.title).routes,
            TrialPage(self.session, self.trials, self.bags).routes,
            WhyPage(self.job, self.provenance, self.title).routes,
        )
        wire(app, self)
        return app

    def show(
        self, selection: Selection, theme_name: str | None, at: Mapping[str, float] | None = None
    ) -> dict[str, Any]:
        """Everything on the page for a selection, keyed as in ``SHOWN``; ``at``: current slider values."""
        theme = THEMES.get(theme_name or "", LIGHT)
        session = self.session
        shown = views.show(session, selection, theme)
        # Submitted before the prefetched fits.
        session.with_final_errors(selection)
        session.fit_ahead(selection)
        panes = self._panes(selection, theme)
        if panes:
            shown = replace(shown, figure=self._narrow(selection, shown, theme))
            views.same_ranges([shown.figure, *(pane.figure for pane in panes if pane.same_axes and pane.figure)])
        query = to_query(selection)
        return {
            **self._previews(selection),
            **self._by_hand(selection, shown, at or {}),
            "atlas.href": f"/atlas{query}",
            "cards.href": f"/effects{query}",
            "why.href": f"/why{query}",
            "observable-row.hidden": selection.view != "residuals",
            "figure.figure": shown.figure,
            "figure.style": blocks.height(shown.figure),
            "figure-how.children": shown.how_to_read,
            "figure-says.children": shown.caption,
            "pane-title.children": self._titled(shown.current.label),
            "pane-title.hidden": not panes,
            "unpin.hidden": not selection.against,
            "ladder.figure": shown.ladder,
            "ladder.style": blocks.height(shown.ladder),
            "ladder-says.children": shown.ladder_caption,
            "beside.children": blocks.panes(panes),
            "trials.children": self._trials(selection, shown, theme),
            "status.children": shown.status,
            "message.children": "",
        }

    def _by_hand(self, selection: Selection, shown: views.Shown, at: Mapping[str, float]) -> dict[str, Any]:
        """The sliders, which are slow to render, and the table of parameters: only with their view."""
        sliders: Any = []
        table = None
        if by_hand := selection.view == "parameters":
            effects = self.session.catalogue(selection.formulas)
            fitted = self.session.step(replace(selection, by_hand=()))
            sliders = _sliders(views.sliders(selection, shown.current, effects), at)
            table = controls.parameter_table(views.parameter_rows(selection, fitted, effects))
        return {"parameters-box.hidden": not by_hand, "by-hand.children": sliders, "parameters.children": table}

    def _previews(self, selection: Selection) -> dict[str, Any]:
        """The list of effects with the error after switching each, and whether all of these fits are done."""
        session, fitted = self.session, replace(selection, by_hand=())
        previews = session.previews(selection)
        effects = session.catalogue(selection.formulas)
        bare = replace(fitted, effects=())
        alone = session.previews(bare)
        stated = session.with_final_errors(fitted)
        complete = stated is not None and all(preview is not None for preview in previews.values())
        options = effect_list.effect_options(
            effects, alone, session.step(bare).fit, session.step(fitted).fit, previews, stated
        )
        return {"effects.options": options, "preview-clock.disabled": complete}

    def _panes(self, selection: Selection, theme: Theme) -> list[views.Pane]:
        """Panes of the second data set under the same selection, and of the second model on the same data."""
        shown = []
        if self.beside is not None:
            # The chosen cell is not marked here: its trials are those of the first data set.
            shown.append(
                views.second_pane(self.beside.session, replace(selection, cell=None), self.beside.title, theme)
            )
            self.beside.session.fit_ahead(selection)
        if (other := selection.other) is not None:
            title = self._titled(f"{self.session.step(other).label}, second model")
            shown.append(views.second_pane(self.session, other, title, theme))
            shown.append(views.difference(self.session, selection, other, theme))
        return shown

    def _titled(self, model: str) -> str:
        """The label of a model, prefixed by its data set if there are two."""
        return model if self.beside is None else f"{self.title}: {model}"

    def _narrow(self, selection: Selection, shown: views.Shown, theme: Theme) -> Spec:
        """The figure for side-by-side display: without the base model, with fewer panels per row."""
        if views.unavailable(selection, shown.current):
            return shown.figure
        return views.figure(selection, None, shown.current, theme, columns=views.PANE_COLUMNS)

    def _trials(self, selection: Selection, shown: views.Shown, theme: Theme) -> Any:
        cells = self.session.cells
        cell = condition.index_of(cells, selection.cell)
        if cell is None:
            missing = condition.not_found(cells, selection.cell)
            return html.P(missing, className="message") if missing else None
        return cell_trials.parts(self.trials, self.bags, shown.current.fit, cell, theme, to_query(selection))

    def send_bag(self, trial_id: str, name: str) -> Response:
        """A file of a recording, only of the bags shown."""
        files = waveforms.files_of(self.bags[trial_id]) if trial_id in self.bags else {}
        return send_file(files[name].resolve(), as_attachment=True) if name in files else abort(404)

    def on_address(
        self, search: str | None, theme: str | None,
        sliders: Sequence[float], slider_ids: Sequence[Mapping[str, str]],
    ) -> dict[str, Any]:  # fmt: skip
        """The address has changed: return the page for it, with the values of the controls (``settle`` in explore.js).

        The page itself sets the controls, since the address may have changed again before this answer arrives.
        """
        if theme is None:
            raise PreventUpdate
        try:
            selection = from_query(search or "")
            set_props("shown", {"data": {"search": search or "", "controls": values_of(selection, self.session.cells)}})
            return self.show(selection, theme, controls.slider_values(slider_ids, sliders))
        except InputError as error:
            return {**dict.fromkeys(SHOWN, no_update), "message.children": _message(error)}

    def on_control(
        self, values: Mapping[str, Any], _clicks: Sequence[Any], sliders: Sequence[float], _recheck: Any,
        slider_ids: Sequence[Mapping[str, str]], formula: str | None, search: str | None,
        shown: Mapping[str, Any] | None, reported: Mapping[str, Any],
    ) -> None:  # fmt: skip
        """A control was used: apply to the address every value not yet reported, and the button pressed.

        The answer marks the values applied as reported: if a control is used before the answer arrives, the page finds
        a different value then, and calls again (``recheck``).
        """
        try:
            before = from_query(search or "")
            after = with_controls(before, reported, values)
            if any(isinstance(control, dict) for control in ctx.triggered_prop_ids.values()):
                fitted = self.session.step(from_query(shown["search"] if shown else "")).fit.parameters
                values_fitted = {name: estimate.value for name, estimate in fitted.items()}
                after = with_sliders(after, values_fitted, controls.slider_values(slider_ids, sliders))
            for fired in ctx.triggered:
                after = self._pressed(after, ctx.triggered_prop_ids[fired["prop_id"]], fired["value"], formula or "")
            self.session.catalogue(after.formulas)
        except InputError as error:
            set_props("message", {"children": _message(error)})
            return
        if after != before:
            set_props("address", {"search": to_query(after)})
        # Last, when the address already contains them.
        if values != reported:
            set_props("reported", {"data": values})

    def _pressed(self, selection: Selection, control: Any, value: Any, formula: str) -> Selection:
        """The selection after a click on a button or a figure; other controls are handled by value."""
        match control:
            case "figure":
                return act(selection, "cell", clicked_option(value, self.session.cells))
            case "add" | "formula":
                return act(selection, "formula", formula)
            case "adopt":
                found = self.job.found_for(selection)
                return with_verdict(selection, found) if found else selection
            case "release" | "pin" | "unpin":
                return act(selection, control, value)
        return selection

    def on_preview_clock(self, _tick: int, search: str | None) -> dict[str, Any]:
        """Show the errors of fits that have ended since; the timer stops after the last one."""
        if search is None:
            raise PreventUpdate
        try:
            return self._previews(from_query(search))
        except InputError:
            return {"effects.options": no_update, "preview-clock.disabled": True}

    def on_save(self, _yaml: int, _csv: int, search: str | None) -> dict[str, Any]:
        """Download the selection as YAML, or the cells as CSV."""
        try:
            selection = from_query(search or "")
            if ctx.triggered_id == "save-csv":
                steps, current = self.session.ladder(selection), self.session.step(selection)
                content = cells_csv((*steps, current) if selection.by_hand else steps)
                return {"content": content, "filename": "cells.csv"}
            return {"content": self.saved(selection), "filename": "explorer.yaml"}
        except InputError:
            raise PreventUpdate from None

    def on_suggest(self, _clicks: int, _tick: int, search: str | None, asked: str | None) -> dict[str, Any]:
        """Start discovery or show its progress; the page polls while it runs, and can then adopt its result.

        ``asked`` is this page's last question: discoveries of other pages are not shown, nor is this page's own once
        the base model or the formulas have changed.
        """
        try:
            selection = from_query(search or "")
        except InputError as error:
            return _suggestion(html.P(str(error)))
        question = to_query(Selection(selection.model, formulas=selection.formulas))
        if ctx.triggered_id == "suggest":
            self.job.start(selection)
        elif asked != question:
            return _suggestion([])
        return self._suggested(selection, search) | {"asked.data": question}

    def _suggested(self, selection: Selection, search: str | None) -> dict[str, Any]:
        job = self.job
        if job.pending(selection):
            now = job.running
            before = now if now is not None and question_of(now) != question_of(selection) else None
            return _suggestion(suggestion.progress(*job.stage, before), running=True)
        if (found := job.found_for(selection)) is None:
            return _suggestion(html.P(job.failed_for(selection)))
        return _suggestion(suggestion.suggestion(found, f"/why{search or ''}"), adopt=can_adopt(found))

    def saved(self, selection: Selection) -> str:
        """The selection as YAML, with the results that ``compare`` gives for it."""
        fit = steps_of(selection, self.session.cells, self.session.catalogue(selection.formulas))[-1]
        result = {
            "rmse_m_s": fit.rmse_m_s,
            "cv_rmse_m_s": fit.cv_rmse_m_s,
            "noise_floor_m_s": self.session.noise_floor_m_s,
        }
        return to_yaml(selection, [str(path) for path in self.data], result, self.options)


def _suggestion(children: Any, *, running: bool = False, adopt: bool = False) -> dict[str, Any]:
    return {
        "suggestion.children": children,
        "suggest-clock.disabled": not running,
        "adopt.hidden": not adopt,
        "asked.data": None,
    }


def _on_error(error: Exception) -> None:
    """A bug in this program or in a user's effect: the page stays as it is, the terminal shows the traceback."""
    traceback.print_exception(error)
    set_props("preview-clock", {"disabled": True})
    set_props("message", {"children": f"That failed: {type(error).__name__}: {error} (the terminal says where)"})


def _sliders(wanted: Sequence[views.Slider], at: Mapping[str, float]) -> Any:
    """New sliders, unless the present ones already have these values: replacing them could lose a key press."""
    if at != {slider.name: slider.value for slider in wanted}:
        return controls.by_hand(wanted)
    for slider in wanted:
        set_props(controls.held_id(slider.name), {"hidden": not slider.held})
    return no_update


def _message(error: InputError) -> str:
    """The error without the command-line option, --effect, which on the page is the formula box."""
    return str(error).removeprefix("--effect ")
