"""A physical effect on a card: plain words, formula, range, source, and where it would show."""

from collections.abc import Mapping

from sandbot_common.terminal import filled, styled
from sandbot_model.discovery.fingerprint import OMEGA_RAD_S, PHI, Fingerprint, fingerprint
from sandbot_model.fitting.text import table
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.typeset import plain
from sandbot_model.report.effect_facts import ABSORBED, DESIGN, OBSERVABLES, range_of, showing, shown_in, words


def card(effect: Effect, catalogue: Mapping[str, Effect]) -> str:
    """The facts about an effect, then where it would show, which is computed (see ``fingerprint``)."""
    facts = [
        ("stage", effect.stage),
        ("formula", plain(effect.formula)),
        *(("range", range_of(parameter)) for parameter in effect.parameters),
        ("seen in", f"{plain(effect.seen_in)} ({OBSERVABLES})"),
        *([("control", effect.control)] if effect.control else []),
        ("source", effect.source),
    ]
    head = [styled(effect.identifier, "bold"), filled(words(effect), "  "), ""]
    lines = [filled(f"{name:<8} {fact}", "  ") for name, fact in facts]
    return "\n".join([*head, *lines, "", _visibility(fingerprint(effect, catalogue))])


def _visibility(found: Fingerprint) -> str:
    """In which observables the effect would show, the clearest first, and a map of the first."""
    shown = shown_in(found)
    if not shown:
        return filled(f"would not show, at its usual strength: {ABSORBED} ({DESIGN})")
    lines = [filled(f"would show in ({DESIGN}, after fitting k(φ), Δt and swimming speed of the simple model):")]
    lines += [filled(showing(found, observable), "  ") for observable in shown]
    rows = [["φ \\ ω [rad/s]", *(f"{omega:g}" for omega in OMEGA_RAD_S)]]
    for phi, row in zip(PHI, found.missed[..., shown[0]], strict=True):
        rows.append([f"{phi:g}", *(f"{value:+.0f}" if abs(value) >= 1.0 else "·" for value in row)])
    return "\n".join([*lines, "", filled(f"{shown[0].label}, standard errors from the simple model:"), table(rows)])
