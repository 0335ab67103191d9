"""``/trial``: the film, legs and records of one trial with a shared time cursor, and a clip to download."""

import tempfile
from collections.abc import Mapping
from functools import lru_cache
from html import escape
from math import cos, sin
from pathlib import Path
from urllib.parse import quote

from flask import Response, abort, request
from plotly.offline import get_plotlyjs

from sandbot_model.discovery.selection import Selection, to_query
from sandbot_model.explore.blocks import FORMATS
from sandbot_model.explore.clip import write_clip
from sandbot_model.explore.pages import Handler, head, held_values, requested_selection
from sandbot_model.explore.scene import Scene, replicates, scene_of
from sandbot_model.explore.scene_figures import over_phase, phase_caption, records, records_caption
from sandbot_model.explore.session import Session
from sandbot_model.report import waveforms
from sandbot_model.report.page import for_script, source
from sandbot_model.report.theme import THEMES
from sandbot_model.report.view import Step
from sandbot_record.bags.reader import Bag
from sandbot_record.trials.cache import file_state
from sandbot_record.trials.film import Film, film_of
from sandbot_record.trials.table import Trials

PAGE = """{head}<h1>{trial}</h1>
<p class="kind">{model}. Other trials of this condition: {others}</p></header>
<main class="trial"><div class="stage">{film}{leg}</div>
<div class="controls"><button type="button" id="play">Play</button>
<span><label for="pace">pace</label> <select id="pace"><option value="1">1</option>
<option value="0.25" selected>1/4</option><option value="0.1">1/10</option></select></span>
<label for="clock">time (s)</label>
<input type="range" id="clock" min="{start}" max="{end}" step="0.005" value="0" autocomplete="off"></div>
<p id="reading" class="reading"></p>
{records}{phase}
<p><a class="download" download="{trial}.mp4" href="/trial/clip.mp4?{address}">Clip of this trial
(MP4, at a quarter of its speed)</a></p></main>
<script src="/plotly.js"></script><script type="application/json" id="scene">{data}</script>
<script>{export}</script><script>{script}</script></body></html>"""
FIGURE = """<figure><div class="scroll" tabindex="0" role="group" aria-labelledby="says-{name}"><div class="screen">
<div class="plot" id="plot-{name}"></div>{cursor}</div></div>
<figcaption><p id="says-{name}">{says}</p><p class="save">Save figure: {buttons}</p></figcaption>
</figure>"""
LEG = """<svg class="leg" viewBox="{left:.3f} {top:.3f} {width:.3f} {height:.3f}" role="img"
aria-label="The model's legs: coloured while they hold">
<rect x="{left:.3f}" y="0" width="{width:.3f}" height="{below:.3f}" class="bed"/>
<g id="ground" data-period="{period}">{stones}</g>
<path d="M{left:.3f} 0 h{width:.3f}" class="surface"/>
<g id="robot"><rect class="body" x="-1.8" y="{roof:.3f}" width="3.6" height="{body:.3f}" rx="0.17"/>
<path id="leg-0" class="arc" d="{arc}"/><path id="leg-1" class="arc second" d="{arc}"/><circle r="0.085"/></g></svg>"""
"""In leg radii, with the hip of the robot's group at the origin."""
STONES, PERIOD = ((0.0, 0.2), (0.4, 0.62), (0.76, 0.37), (0.23, 1.0), (0.9, 1.2)), 1.12
"""Places of stones in the ground, and the distance after which they repeat [leg radii]."""


class TrialPage:
    """``/trial`` for the trial and the selection in its address, its frames and its clip."""

    def __init__(self, session: Session, trials: Trials, bags: Mapping[str, Path]) -> None:
        self._session, self._trials, self._bags = session, trials, bags
        self._film = lru_cache(maxsize=4)(self._opened)
        self._frame = lru_cache(maxsize=1024)(lambda trial_id, i: self._filmed(trial_id).jpeg(i))

    @property
    def routes(self) -> dict[str, Handler]:
        """Its addresses, and what answers each."""
        return {
            "/trial": self.page,
            "/trial/frame/<trial_id>/<int:i>.jpg": self.frame,
            "/trial/clip.mp4": self.clip,
            "/plotly.js": _plotly,
        }

    def page(self) -> Response:
        """The page of the trial."""
        scene, trial, address, query, model = self._request()
        film = self._film(trial)
        fit = self._session.step(requested_selection("trial")).fit
        others = replicates(self._trials, fit, scene.cell)
        found, _ = waveforms.read(self._bags, others)
        walking = [waveform for waveform in found if len(waveform.leg_time_s)]
        figures = {
            "records": {name: records(scene, theme) for name, theme in THEMES.items()},
            "phase": {name: over_phase(scene, walking, theme) for name, theme in THEMES.items()},
        }
        times = [] if film is None else film.time_s.round(4).tolist()
        links = ", ".join(self._link(name, query) for name in others if name != trial) or "none"
        return Response(
            PAGE.format(
                head=head(trial, query), trial=escape(trial), model=escape(model), others=links,
                film="" if film is None else _screen(trial, self._bags[trial]), leg=_leg(scene),
                start=min(0.0, float(scene.waveform.time_s[0])), end=scene.end_s, address=escape(address),
                records=_figure("records", records_caption(scene), '<div id="cursor" class="cursor"></div>'),
                phase=_figure("phase", phase_caption(walking)),
                data=for_script({"scene": scene.to_dict(), "frames": times, "figures": figures}),
                export=source("export.js"), script=source("trial.js"),
            ), mimetype="text/html",
        )  # fmt: skip

    def frame(self, trial_id: str, i: int) -> Response:
        """One lateral frame with the tracked marks."""
        film = self._film(trial_id) if trial_id in self._bags else None
        if film is None or i >= len(film.stamp_ns):
            abort(404)
        answer = Response(self._frame(trial_id, i), mimetype="image/jpeg")
        answer.cache_control.max_age = 3600
        return answer

    def clip(self) -> Response:
        """The trial as MP4."""
        scene, trial, _, _, _ = self._request()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "clip.mp4"
            write_clip(path, scene, self._film(trial))
            return Response(path.read_bytes(), mimetype="video/mp4")

    def _request(self) -> tuple[Scene, str, str, str, str]:
        """The request: scene, trial, query strings of the trial and of the selection, and name of the model."""
        selection, trial = requested_selection("trial"), request.args.get("trial", "")
        self._session.model(selection)
        # Including the values held by hand, as for the trials of a cell.
        step = self._session.step(selection)
        query = to_query(selection)
        address = f"trial={quote(trial)}{query.replace('?', '&')}"
        return scene_of(self._trials, self._bags, step.fit, trial), trial, address, query, _model(selection, step)

    def _link(self, trial: str, query: str) -> str:
        if trial not in self._bags:
            return escape(trial)
        return f'<a href="/trial?trial={quote(trial)}{escape(query.replace("?", "&"))}">{escape(trial)}</a>'

    def _opened(self, trial_id: str) -> Film | None:
        return film_of(Bag.open(self._bags[trial_id]))

    def _filmed(self, trial_id: str) -> Film:
        film = self._film(trial_id)
        assert film is not None
        return film


def _model(selection: Selection, step: Step) -> str:
    """Name of the model drawn, with the values held by hand."""
    held = held_values(selection)
    return f"{step.whole_label}, held by hand: {held}" if held else step.whole_label


def _plotly() -> Response:
    answer = Response(get_plotlyjs(), mimetype="text/javascript")
    answer.cache_control.max_age = 86400
    return answer


def _screen(trial: str, bag: Path) -> str:
    # A browser keeps the frames; those of the trial run again have other addresses.
    frame = f"/trial/frame/{quote(trial)}/FRAME.jpg?bag={file_state(bag)}"
    first = frame.replace("FRAME", "0")
    return f'<img id="film" alt="Lateral camera, tracked axles marked" data-address="{frame}" src="{first}">'


def _leg(scene: Scene) -> str:
    """SVG of the robot from the side."""
    half, above, below = scene.frame
    belly = scene.axle_height_m / scene.radius_m
    stones = "".join(
        f'<circle class="stone" cx="{PERIOD * n + x:.3f}" cy="{y}" r="0.045"/>' for n in range(-3, 4) for x, y in STONES
    )
    return LEG.format(
        left=-half, top=-above, width=2 * half, height=above + below, below=below, roof=-0.25 * belly,
        body=1.25 * belly, stones=stones, period=PERIOD,
        arc=f"M0 0 A1 1 0 1 1 {sin(scene.arc_rad):.4f} {1 - cos(scene.arc_rad):.4f}",
    )  # fmt: skip


def _figure(name: str, says: str, cursor: str = "") -> str:
    buttons = " ".join(
        f'<button type="button" data-figure="{name}" data-format="{kind}" aria-label="Save figure {name} as '
        f'{kind.upper()}">{kind.upper()}</button>'
        for kind in FORMATS
    )
    return FIGURE.format(name=name, says=escape(says), cursor=cursor, buttons=buttons)
