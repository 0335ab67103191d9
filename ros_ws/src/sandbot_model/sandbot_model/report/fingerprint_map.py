"""The fingerprint of an effect as a picture: what the base model would miss over φ × ω, in each observable."""

import numpy as np

from sandbot_model.discovery.fingerprint import OMEGA_RAD_S, PHI, SEEN, Fingerprint
from sandbot_model.physics.observables import Observable
from sandbot_model.report.theme import DARK, LIGHT, Theme

CELL, GAP, LEFT, TOP = 14, 18, 38, 18
COLOUR_END = 8.0
ALPHA = 0.15
"""Opacity of the weakest deviation drawn."""


def fingerprint_map(found: Fingerprint) -> str:
    """An SVG document of four maps, φ upwards and ω to the right; blue: below the base model, orange: above."""
    wide, high = CELL * len(OMEGA_RAD_S), CELL * len(PHI)
    maps = "".join(
        f'<g transform="translate({LEFT + i * (wide + GAP)} {TOP})">'
        f'<text y="-5">{observable.label}</text>{_cells(found.missed[..., observable])}</g>'
        for i, observable in enumerate(Observable)
    )
    width, height = LEFT + len(Observable) * (wide + GAP), TOP + high + 20
    rows = "".join(
        f'<text class="soft" x="0" y="{TOP + CELL * (len(PHI) - 1 - row) + 11}">{PHI[row]:g}</text>'
        for row in (0, len(PHI) - 1)
    )
    ends = f'<text class="soft" x="{LEFT}" y="{height - 6}">ω {OMEGA_RAD_S[0]:g} to {OMEGA_RAD_S[-1]:g} rad/s</text>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">'
        f"<style>{_colours(LIGHT)} @media (prefers-color-scheme: dark) {{ {_colours(DARK)} }}</style>"
        f"{maps}{rows}{ends}</svg>\n"
    )


def _cells(missed: np.ndarray) -> str:
    """One map; cells in which the effect would show are framed."""
    squares = []
    for (row, column), value in np.ndenumerate(missed):
        place = f'x="{CELL * column}" y="{CELL * (len(PHI) - 1 - row)}" width="{CELL - 1}" height="{CELL - 1}"'
        strength = min(abs(float(value)) / COLOUR_END, 1.0)
        kind = "above" if value > 0 else "below"
        squares.append(f'<rect class="empty" {place}/>')
        if abs(value) >= 1.0:
            squares.append(f'<rect class="{kind}" {place} fill-opacity="{max(strength, ALPHA):.2f}"/>')
        if abs(value) >= SEEN:
            squares.append(f'<rect class="frame" {place}/>')
    return "".join(squares)


def _colours(theme: Theme) -> str:
    below, _, above = theme.diverging
    return (
        f".empty {{ fill: {theme.empty}; }} .above {{ fill: {above}; }} .below {{ fill: {below}; }} "
        f".frame {{ fill: none; stroke: {theme.ink}; }} "
        f"text {{ font: 12px Helvetica, Arial, sans-serif; fill: {theme.ink}; }} .soft {{ font-size: 11px; }}"
    )
