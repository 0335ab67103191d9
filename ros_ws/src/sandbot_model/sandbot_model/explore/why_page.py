"""``/why``: the argument for the verdict on the base model shown; runs the discovery first if there is none yet."""

import json
from dataclasses import replace
from functools import lru_cache
from html import escape

from flask import Response

from sandbot_model.discovery.result import Discovery
from sandbot_model.discovery.selection import Selection, to_query
from sandbot_model.explore.job import Job
from sandbot_model.explore.pages import Handler, head, held_values_note, requested_selection
from sandbot_model.report.argument import argument_page
from sandbot_model.report.page import render
from sandbot_model.report.view import Provenance

WAITING = """{head}<h1>{title}</h1></header>
<main><p id="stage" role="status">Trying the catalogue on these trials.</p>
<progress id="done" value="0" max="1" aria-label="Sets of effects tried"></progress></main>
<script>{script}</script></body></html>"""
SCRIPT = """"use strict";
(async function ask() {
  const { running, failed, stage, done, total } = await (await fetch(`/why/progress${location.search}`)).json();
  if (failed) { document.getElementById("stage").textContent = failed; return; }
  if (!running) { location.reload(); return; }
  document.getElementById("stage").textContent = `Trying ${stage}: ${done} of ${total}`;
  Object.assign(document.getElementById("done"), { max: Math.max(total, 1), value: done });
  setTimeout(ask, 300);
})();
"""


class WhyPage:
    """``/why`` for the selection in its address, and ``/why/progress``."""

    def __init__(self, job: Job, provenance: Provenance, title: str) -> None:
        self._job, self._provenance, self._title = job, provenance, title
        self._rendered = lru_cache(maxsize=4)(self._render)

    @property
    def routes(self) -> dict[str, Handler]:
        """Its addresses, and what answers each."""
        return {"/why": self.page, "/why/progress": self.progress}

    def page(self) -> Response:
        """The argument, or the progress of the discovery that it needs."""
        selection = requested_selection()
        self._job.session.model(selection)
        found = self._job.found_for(selection)
        if found is not None:
            return Response(self._rendered(found, selection), mimetype="text/html")
        self._job.start(selection)
        start = head(f"Why: {self._title}", to_query(selection))
        waiting = WAITING.format(head=start, title=escape(self._title), script=SCRIPT)
        return Response(waiting, mimetype="text/html")

    def progress(self) -> Response:
        """The progress, as JSON."""
        job = self._job
        selection = requested_selection()
        stage, done, total = job.stage
        state = {
            "running": job.pending(selection), "failed": job.failed_for(selection),
            "stage": stage, "done": done, "total": total,
        }  # fmt: skip
        return Response(json.dumps(state), mimetype="application/json")

    def _render(self, found: Discovery, asked: Selection) -> str:
        page = argument_page(found, self._provenance, title=self._title, back=f"/{to_query(asked)}")
        held = [("By hand.", held_values_note(asked))] if asked.by_hand else []
        return render(replace(page, cautions=(*page.cautions, *held)))
