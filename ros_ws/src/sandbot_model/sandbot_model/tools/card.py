"""A physical effect on a card: plain words, formula, range, source, and where it would show."""

from collections.abc import Mapping

from sandbot_common.terminal import filled, styled
from sandbot_model.discovery.fingerprint import OMEGA_RAD_S, PHI, SEEN, TRIALS, Fingerprint, fingerprint
from sandbot_model.fitting.text import table
from sandbot_model.physics.effect import Effect, Parameter
from sandbot_model.physics.observables import Observable
from sandbot_model.physics.typeset import plain
from sandbot_model.tools.answer import words


def card(effect: Effect, catalogue: Mapping[str, Effect]) -> str:
    """What is known of an effect, then where it would show, which is computed (see ``fingerprint``)."""
    facts = [
        ("stage", effect.stage),
        ("formula", plain(effect.formula)),
        *(("range", _range(parameter)) for parameter in effect.parameters),
        ("seen in", f"{plain(effect.seen_in)} (v speed, L lift, W waveform, T torque, P pitch)"),
        ("source", effect.source),
    ]
    head = [styled(effect.identifier, "bold"), filled(words(effect), "  "), ""]
    told = [filled(f"{name:<8} {said}", "  ") for name, said in facts]
    return "\n".join([*head, *told, "", _where(fingerprint(effect, catalogue))])


def _range(parameter: Parameter) -> str:
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    return (
        f"{parameter.name} {parameter.low:g} to {parameter.high:g}{unit}, usually {parameter.start:g}: {parameter.doc}"
    )


def _where(found: Fingerprint) -> str:
    """In which observables it would show, most telling first, and a map of the first."""
    most = sorted(Observable, key=lambda observable: -abs(found.largest(observable)[0]))
    shown = [observable for observable in most if abs(found.largest(observable)[0]) >= SEEN]
    trials = f"{TRIALS} trials in each of {len(PHI)} x {len(OMEGA_RAD_S)} conditions"
    if not shown:
        absorbed = "k(φ), Δt and the swimming speed of the simple model follow it"
        return filled(f"would not show, at its usual strength: {absorbed} ({trials})")
    lines = [filled(f"would show in ({trials}, once k(φ), Δt and swimming speed of the simple model have followed):")]
    for observable in shown:
        errors, phi, omega = found.largest(observable)
        where = f"{abs(errors):.0f} standard errors {'above' if errors > 0 else 'below'} it"
        lines.append(filled(f"{observable.label}: {where} at φ {phi:g}, ω {omega:g} rad/s", "  "))
    rows = [["φ \\ ω [rad/s]", *(f"{omega:g}" for omega in OMEGA_RAD_S)]]
    for phi, row in zip(PHI, found.missed[..., shown[0]], strict=True):
        rows.append([f"{phi:g}", *(f"{value:+.0f}" if abs(value) >= 1.0 else "·" for value in row)])
    return "\n".join([*lines, "", filled(f"{shown[0].label}, standard errors from the simple model:"), table(rows)])
