"""``/effects``: every effect as a physics card with a switch, those that help these data first."""

from functools import lru_cache
from html import escape

from flask import Response, abort

from sandbot_model.discovery.fingerprint import Fingerprint, fingerprint
from sandbot_model.discovery.selection import Selection, to_query
from sandbot_model.explore.pages import Handler, head, held_values_note, model_only, requested_selection
from sandbot_model.explore.previews import change_of, delta_bic, folded, ordered
from sandbot_model.explore.session import Session
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.typeset import mathml_in_pieces
from sandbot_model.report import text
from sandbot_model.report.captions import PERFECT
from sandbot_model.report.drawings import drawing
from sandbot_model.report.effect_facts import DESIGN, range_text, words
from sandbot_model.report.fingerprint_map import fingerprint_map
from sandbot_model.report.view import readable

PAGE = """{head}<h1>{title}</h1>
<p>Those switched on, then by ΔBIC, best first. It counts all that is measured: an effect may lower it and raise the
error of mean speed.</p>
<p>Error of mean speed with {model}: <strong>{now}</strong>. Noise floor: {floor}, {perfect}.
{held_values}</p>
{pending}</header>
<main class="cards">{cards}{folded}</main>{script}</body></html>"""
CARD = """<article class="card" id="{name}" aria-labelledby="h-{name}">{picture}
<div><h2 id="h-{name}">{heading}</h2><p class="change">{change}</p><p class="kind">{delta_bic}</p>
<p><a class="switch" href="/{query}">{verb} {heading}</a></p></div>
<div class="facts"><p>{words}.</p><p class="formula" tabindex="0" role="group" aria-label="formula">{formula}</p>
<dl><dt>acts on</dt><dd>{stage}</dd>{ranges}<dt>source</dt><dd>{source}</dd></dl>
<details class="print"><summary>Where it would show</summary>
<img loading="lazy" src="/effects/{name}/fingerprint.svg{own}" alt="Fingerprint of {heading} over φ and ω">
<p class="kind">What the simple model would miss ({design}), at the effect's usual strength: orange above, blue below
the model; framed: 3 standard errors or more.</p></details></div></article>"""
RELOAD = "<script>setTimeout(() => location.reload(), 1000);</script>"
"""Reloads the page while fits are still being prefetched."""


class CardsPage:
    """``/effects`` for the selection in its address, ``/drawing/NAME.svg`` and ``/effects/NAME/fingerprint.svg``."""

    def __init__(self, session: Session, title: str) -> None:
        self._session, self._title = session, title
        self._fingerprint = lru_cache(maxsize=64)(self._computed)

    @property
    def routes(self) -> dict[str, Handler]:
        """Its addresses, and what answers each."""
        return {
            "/effects": self.page,
            "/drawing/<name>.svg": self.drawing,
            "/effects/<name>/fingerprint.svg": self.fingerprint,
        }

    def page(self) -> Response:
        """All cards; those of effects that do not help are folded."""
        asked = requested_selection()
        selection = model_only(asked)
        self._session.model(selection)
        now = self._session.step(selection)
        self._session.fit_ahead(selection)
        previews = self._session.previews(selection)
        effects = self._session.catalogue(selection.formulas)
        names = ordered(previews, selection.effects)
        now_m_s = now.fit.rmse_m_s
        cards = {name: self._card(effects[name], asked, previews[name], now.fit) for name in names}
        rest = [cards[name] for name in names if folded(effects[name], previews[name], now.fit)]
        pending = any(preview is None for preview in previews.values())
        return Response(
            PAGE.format(
                head=head(title := f"Effects: {self._title}", to_query(asked)), title=escape(title),
                held_values=escape(held_values_note(asked)), model=escape(now.label.removeprefix("+ ")),
                now=text.cm_s(now_m_s), perfect=PERFECT, floor=text.cm_s(self._session.noise_floor_m_s),
                cards="".join(card for card in cards.values() if card not in rest),
                folded=f"<details class='rest'><summary>{len(rest)} effects that do not help these data now</summary>"
                f"{''.join(rest)}</details>" if rest else "",
                pending='<p role="status">Some effects are still being fitted.</p>' if pending else "",
                script=RELOAD if pending else "",
            ), mimetype="text/html",
        )  # fmt: skip

    def drawing(self, name: str) -> Response:
        """The drawing of an effect of the catalogue."""
        drawn = drawing(name)
        return abort(404) if drawn is None else Response(drawn, mimetype="image/svg+xml")

    def fingerprint(self, name: str) -> Response:
        """The fingerprint of an effect as a picture."""
        formulas = requested_selection().formulas
        if name not in self._session.catalogue(formulas):
            abort(404)
        return Response(fingerprint_map(self._fingerprint(name, formulas)), mimetype="image/svg+xml")

    def _computed(self, name: str, formulas: tuple[str, ...]) -> Fingerprint:
        effects = self._session.catalogue(formulas)
        return fingerprint(effects[name], effects)

    def _card(self, effect: Effect, selection: Selection, preview: tuple[float, float] | None, now: Fit) -> str:
        name, heading = effect.identifier, escape(readable(effect.identifier))
        on = name in selection.effects
        others = [other for other in selection.effects if other != name]
        toggled = selection.toggled(others if on else [*selection.effects, name])
        picture = f'<img src="/drawing/{name}.svg" alt="" width="160" height="100">' if drawing(name) else ""
        ranges = "".join(f"<dt>{text.symbol(p)}</dt><dd>{escape(range_text(p))}</dd>" for p in effect.parameters)
        return CARD.format(
            name=escape(name), picture=picture, heading=heading, verb="Switch off" if on else "Switch on",
            change=change_of(preview, on, now.rmse_m_s), delta_bic=delta_bic(preview, on, now.bic),
            query=escape(to_query(toggled)), words=escape(words(effect)),
            formula=mathml_in_pieces(effect.formula), stage=effect.stage, ranges=ranges, source=escape(effect.source),
            own=escape(to_query(Selection(formulas=selection.formulas))), design=DESIGN,
        )  # fmt: skip
