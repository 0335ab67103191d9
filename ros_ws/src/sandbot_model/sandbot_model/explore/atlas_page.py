"""``/atlas``: the paper's figures from the trials and the model shown, drawn on request."""

import threading
from collections.abc import Mapping
from functools import lru_cache
from html import escape
from pathlib import Path

from flask import Response, abort

from sandbot_common.errors import InputError
from sandbot_model.discovery.selection import Selection, to_query
from sandbot_model.explore.pages import Handler, head, held_values_note, model_only, requested_selection
from sandbot_model.explore.session import Session
from sandbot_model.report.atlas.collect import collect
from sandbot_model.report.atlas.material import ONE_COLUMN_MM, Material, Plate
from sandbot_model.report.atlas.plates import PLATES, as_svg
from sandbot_record.trials.table import Trials

PAGE = """{head}<h1>{title}</h1>
<p>The figures of Li et al. 2009 from these trials. Model: {model}. {held_values_note}</p></header>
<main><section id="atlas">{plates}</section></main></body></html>"""
KEPT = 64
"""Number of plates cached."""


class AtlasPage:
    """``/atlas`` for the selection in its address, and ``/atlas/<stem>.svg``."""

    def __init__(self, session: Session, trials: Trials, bags: Mapping[str, Path], title: str) -> None:
        """``bags`` are the trials' by name."""
        self._session, self._trials, self._bags, self._title = session, trials, bags, title
        # Matplotlib's settings are global to the process.
        self._lock = threading.Lock()
        self._material = lru_cache(maxsize=4)(self._gathered)
        self._plate = lru_cache(maxsize=KEPT)(self._drawn)

    @property
    def routes(self) -> dict[str, Handler]:
        """Its addresses, and what answers each."""
        return {"/atlas": self.page, "/atlas/<stem>.svg": self.plate}

    def page(self) -> Response:
        """All plates; one that can't be drawn from these data is replaced by the reason."""
        asked = requested_selection()
        selection = model_only(asked)
        model = self._session.ladder(selection)[-1].whole_label
        shown = "".join(self._figure(plate, selection) for plate in PLATES)
        content = PAGE.format(
            head=head(title := f"Atlas: {self._title}", to_query(asked)), title=escape(title),
            model=escape(model), held_values_note=escape(held_values_note(asked)), plates=shown,
        )  # fmt: skip
        return Response(content, mimetype="text/html")

    def plate(self, stem: str) -> Response:
        """One plate as a picture."""
        plate = next((p for p in PLATES if p.stem == stem), None)
        if plate is None:
            abort(404)
        return Response(self._plate(plate, model_only(requested_selection()))[0], mimetype="image/svg+xml")

    def _figure(self, plate: Plate, selection: Selection) -> str:
        number = f"Fig. {plate.number} of the paper"
        try:
            _, caption = self._plate(plate, selection)
        except InputError as error:
            return f'<figure class="frame"><figcaption>{number}: not drawn, {escape(str(error))}.</figcaption></figure>'
        wide = " wide" if plate.width_mm > ONE_COLUMN_MM else ""
        address = escape(f"/atlas/{plate.stem}.svg{to_query(selection)}")
        words = escape(f"{number}. {caption}")
        return (
            f'<figure class="frame{wide}"><img src="{address}" alt="{words}"><figcaption>{words}</figcaption></figure>'
        )

    def _drawn(self, plate: Plate, selection: Selection) -> tuple[bytes, str]:
        with self._lock:
            return as_svg(plate, self._material(selection))

    def _gathered(self, selection: Selection) -> Material:
        steps = self._session.ladder(selection)
        return collect(self._trials, [step.fit for step in steps], self._bags)
