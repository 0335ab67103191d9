"""docs/physics.md says what the code does."""

import math
import re
from pathlib import Path

import pytest

from sandbot_common.robot import SANDBOT
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.gait import GAITS, slow_phase_ratio
from sandbot_model.physics.typeset import statements

PAGE = (Path(__file__).parents[3] / "docs" / "physics.md").read_text(encoding="utf-8")


def row(effect):
    """An effect as a line of the catalogue."""
    ranges = "; ".join(
        f"{one.symbol or one.name}: `{one.name}` {one.low:g} to {one.high:g}{f' {one.unit}' if one.unit != '1' else ''}"
        for one in effect.parameters
    )
    cells = (effect.identifier, effect.stage, f"`{effect.formula}`", ranges or "–", effect.seen_in, effect.source)
    return f"| {' | '.join(cells)} |"


def section(number):
    return re.split(r"^## ", PAGE, flags=re.M)[number].partition("\n")[2]


def test_the_catalogue_is_the_codes():
    table = [line for line in section(6).splitlines() if line.startswith("| ")]
    assert table[1:] == list(map(row, CATALOGUE))


def test_every_quantity_of_a_formula_is_explained():
    explained = set(re.findall(r"\w+", section(6).partition("Seen in:")[0])) | {"pi", "lambda"}
    for effect in CATALOGUE:
        lines, _ = statements(effect.formula)
        own = {one.symbol or one.name for one in effect.parameters} | {one.left.partition("(")[0] for one in lines}
        own |= {inner for one in lines for inner in re.findall(r"\((\w+)\)", one.left)}
        formula = " ".join(one.right for one in lines)
        used = set(re.findall(r"(?<![\w.])[A-Za-z_]\w*", formula))
        functions = set(re.findall(r"([A-Za-z_]\w*)\(", formula))
        assert used - functions - own <= explained, effect.identifier
    assert "unheard_of" not in explained


@pytest.mark.parametrize(
    ("symbol", "value"),
    [
        ("R", SANDBOT.leg_radius_m),
        ("h", SANDBOT.axle_height_m),
        ("w", SANDBOT.leg_width_m),
        ("Δξ", math.degrees(SANDBOT.arc_excess_rad)),
        ("m", SANDBOT.mass_per_leg_kg),
        ("g", SANDBOT.gravity_m_s2),
    ],
)
def test_the_robot_is_the_codes(symbol, value):
    line = next(line for line in section(1).splitlines() if line.startswith(f"| {symbol} |"))
    assert float(re.search(r"[\d.]+", line.split("|")[2])[0]) == pytest.approx(value)


@pytest.mark.parametrize("gait", GAITS)
def test_the_gaits_are_the_codes(gait):
    line = next(line for line in section(1).splitlines() if line.startswith(f"| {gait}"))
    assert float(line.split("|")[-2]) == pytest.approx(slow_phase_ratio(gait), abs=5e-4)
    theta_s, theta_0, duty = (cell.strip().removesuffix(" rad").replace("−", "-") for cell in line.split("|")[2:5])
    assert (theta_s.replace("π", "3.141592653589793"), float(theta_0), float(duty)) == (
        str(GAITS[gait][0]), GAITS[gait][1], GAITS[gait][2]
    )  # fmt: skip
