"""The list of effects with the change of the error by each, and the input of a user's own formula."""

from collections.abc import Mapping
from typing import Any

from dash import html

from sandbot_common.errors import InputError
from sandbot_model.explore.blocks import table
from sandbot_model.explore.previews import Preview, change_of, delta_bic, folded, ordered
from sandbot_model.explore.static_html import static
from sandbot_model.explore.views import fitted_values
from sandbot_model.fitting.fit import Fit
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.symbols import listed
from sandbot_model.physics.typeset import mathml_in_pieces, plain
from sandbot_model.report.drawings import drawing
from sandbot_model.report.view import readable


def effect_options(
    effects: Mapping[str, Effect],
    alone: Mapping[str, Preview],
    base: Fit,
    now: Fit,
    previews: Mapping[str, Preview],
    stated: Fit | None,
) -> list[dict[str, Any]]:
    """One option for each effect: drawing, name, ΔBIC by which they are ordered, error before → after it is switched
    on, stage, formula, and fitted values if it is on. Effects that do not help get a class by which the page folds them
    away.

    ``alone`` are the previews of each added to ``base``. ``now`` is the fit shown, ``stated`` the same with final
    standard errors, once they are known.
    """
    on = now.effects
    options = []
    for name in ordered(alone):
        effect, preview = effects[name], previews[name]
        change = delta_bic(alone[name], False, base.bic)
        label = static(
            html.Img(src=f"/drawing/{name}.svg", alt="", className="drawing") if drawing(name) else None,
            html.Span(readable(name), className="effect"),
            html.Span(change_of(preview, name in on, now.rmse_m_s), className="preview"),
            html.Small([f"{change}; " if change else "", f"{effect.stage}: ", _typeset(effect.formula)]),
            html.Small(fitted_values(effect, stated) if stated else "…", className="values") if name in on else None,
            className="effect-line useless" if folded(effect, preview, now) else "effect-line",
        )
        options.append({"value": name, "label": label, "title": plain(effect.seen_in)})
    return options


def formula_read(typed: str) -> list[Any]:
    """A formula as parsed while it is typed: typeset, or the error in it."""
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


def symbols() -> html.Span:
    """Table of all symbols; a click on one inserts it into the formula (explore.js)."""
    rows = [
        (
            [html.Button(name, type="button", **{"data-symbol": name}) for name in symbol.spellings[:1]],
            symbol.unit, symbol.stage, symbol.doc,
        )
        for symbol in listed()
    ]  # fmt: skip
    return static(table("Quantities of the chain, in its order", ("symbol", "unit", "from stage", "meaning"), rows))


def _typeset(formula: str) -> html.Span:
    """A formula as MathML, inserted by explore.js since Dash has no such element."""
    return html.Span(title=formula, className="formula", **{"data-html": mathml_in_pieces(formula)})
