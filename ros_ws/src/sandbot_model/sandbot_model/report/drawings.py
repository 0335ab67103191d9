"""A small drawing of the leg or the bed for each effect of the catalogue: one function per effect, with its name.

Forward is to the right. What the effect adds is drawn in the accent colour; the rest is common to all. Colours follow
the reader's system, even where a page includes the drawing as an image.
"""

import math
from collections.abc import Callable, Iterable

WIDTH, HEIGHT = 160, 100
SURFACE = 52
"""y of the undisturbed surface, from the top."""
RADIUS = 20
Surface = Callable[[float], float]
"""x → y of the ground surface, from the top."""
STYLE = """<style>
svg { --ink: #1b1f24; --soft: #767d86; --accent: #c25a00; --bed: #ece7dc; --grain: #9c8f78; --paper: #fff; }
@media (prefers-color-scheme: dark) {
  svg { --ink: #e8eaed; --soft: #9aa1aa; --accent: #f09142; --bed: #2c2a26; --grain: #8d836f; --paper: #171a1f; }
}
.ink, .new, .was { fill: none; stroke: var(--ink); stroke-width: 2.5; stroke-linecap: round; stroke-linejoin: round; }
.new { stroke: var(--accent); } .thick { stroke-width: 7; }
.was { stroke: var(--soft); stroke-width: 1.5; stroke-dasharray: 3 3; }
.body { fill: var(--paper); stroke: var(--ink); stroke-width: 2; } .bed { fill: var(--bed); }
.grain { fill: var(--grain); } .newgrain { fill: var(--accent); } .dot { fill: var(--ink); }
text { font: 12px Helvetica, Arial, sans-serif; fill: var(--ink); }
</style>"""


def drawing(effect: str) -> str | None:
    """The drawing of an effect as an SVG document; None where there is none, as for a user's own effect."""
    motif = MOTIFS.get(effect)
    if motif is None:
        return None
    box = f'viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {box}>{STYLE}{motif()}</svg>\n'


def _level(_x: float) -> float:
    return SURFACE


def _bed(top: Surface = _level, grains: bool = True) -> str:
    """Ground below a surface ``top(x)``."""
    xs = range(0, WIDTH + 1, 4)
    line = " ".join(f"{x},{top(x):.1f}" for x in xs)
    dots = _grains((_scattered(n) for n in range(46)), top) if grains else ""
    ground = f'<polygon class="bed" points="0,{HEIGHT} {line} {WIDTH},{HEIGHT}"/>'
    return f'{ground}{dots}<polyline class="ink" points="{line}"/>'


def _scattered(n: int) -> tuple[float, float]:
    """The n-th point of a quasi-random sequence (additive recurrence) over the ground."""
    return WIDTH * (0.7549 * n % 1.0), SURFACE + 6 + (HEIGHT - SURFACE - 8) * (0.5698 * n % 1.0)


def _grains(at: Iterable[tuple[float, float]], top: Surface | None = None, kind: str = "grain") -> str:
    return "".join(
        f'<circle class="{kind}" cx="{x:.1f}" cy="{y:.1f}" r="1.6"/>' for x, y in at if top is None or y > top(x) + 3
    )


def _leg(x: float, y: float, turned: float, kind: str = "ink") -> str:
    """A c-leg with its hip at (x, y), turned clockwise from straight down [degrees]."""
    path = f'<path class="{kind}" d="M0 0 A{RADIUS} {RADIUS} 0 0 1 0 {2 * RADIUS}"'
    return f'{path} transform="translate({x} {y}) rotate({turned})"/>'


def _body(x: float, y: float, length: float = 84) -> str:
    """The body, centred at (x, y)."""
    return f'<rect class="body" x="{x - length / 2}" y="{y - 7}" width="{length}" height="14" rx="5"/>'


def _hip(x: float, y: float) -> str:
    return f'<circle class="dot" cx="{x}" cy="{y}" r="3"/>'


def _arrow(x: float, y: float, to_x: float, to_y: float, kind: str = "new") -> str:
    along = math.atan2(to_y - y, to_x - x)
    ends = [(to_x - 7 * math.cos(along + side), to_y - 7 * math.sin(along + side)) for side in (-0.5, 0.5)]
    head = " ".join(f"{a:.1f},{b:.1f}" for a, b in [ends[0], (to_x, to_y), ends[1]])
    return f'<path class="{kind}" d="M{x} {y} L{to_x} {to_y}"/><polyline class="{kind}" points="{head}"/>'


def _words(x: float, y: float, text: str) -> str:
    return f'<text x="{x}" y="{y}">{text}</text>'


def _curve(points: Iterable[tuple[float, float]], kind: str) -> str:
    return f'<polyline class="{kind}" points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in points)}"/>'


def _crater(x: float, depth: float, width: float) -> Surface:
    """A surface with a dip at x."""
    return lambda at: SURFACE + depth * math.exp(-(((at - x) / width) ** 2))


def _standing(x: float = 80, deep: float = 14) -> str:
    """A leg that holds in the ground, with the body."""
    y = SURFACE + deep - 2 * RADIUS
    return _leg(x, y, 0) + _body(x, y) + _hip(x, y)


def _axes(across: str, up: str) -> str:
    """Axes of a small graph."""
    return _arrow(28, 84, 150, 84, "ink") + _arrow(28, 84, 28, 12, "ink") + _words(122, 97, across) + _words(4, 22, up)


def disturbed_ground() -> str:
    """A leg lands beside the previous footprint, in ground loosened by it."""
    patch = f'<path class="bed" d="M36 {SURFACE + 2} A34 26 0 0 0 104 {SURFACE + 2} Z"/>'
    loose = _grains(((40 + 9.5 * n % 62, SURFACE + 6 + 7.3 * n % 17) for n in range(11)), kind="newgrain")
    ring = f'<path class="new" d="M38 {SURFACE + 3} A32 24 0 0 0 102 {SURFACE + 3}"/>'
    return _bed() + patch + loose + ring + _leg(54, 26, 0, "was") + _standing(84, 20)


def exact_vertical_acceleration() -> str:
    """The body is accelerated forward and up; the leg bears only the vertical component."""
    return (
        _bed() + _standing(60) + _arrow(104, 28, 146, 10, "was") + _arrow(104, 28, 104, 8) + _words(108, 44, "only a_z")
    )


def exact_leg_arc() -> str:
    """The ground pushes on every piece of the arc."""
    forces = ""
    for turn in (20, 50, 80, 110, 140):
        angle = math.radians(turn)
        x, y = 72 + RADIUS * math.cos(angle), 62 + RADIUS * math.sin(angle)
        forces += _arrow(
            x + 14 * math.cos(angle), y + 14 * math.sin(angle), x + 3 * math.cos(angle), y + 3 * math.sin(angle)
        )
    return _bed() + f'<circle class="ink" cx="72" cy="62" r="{RADIUS}"/>' + forces + _hip(72, 42)


def stance_overlap() -> str:
    """Both tripods stand at once and pull against each other."""
    y = SURFACE - 26
    legs = _leg(52, y, 18) + _leg(112, y, -18)
    return (
        _bed()
        + legs
        + _body(82, y, 100)
        + _hip(52, y)
        + _hip(112, y)
        + _arrow(74, 78, 50, 78)
        + _arrow(94, 78, 118, 78)
    )


def swimming_thrust() -> str:
    """The belly lies on the ground; legs sweep through it and push."""
    return (
        _bed()
        + _leg(70, 46, 40)
        + _leg(70, 46, 0, "was")
        + _body(82, 44, 100)
        + _hip(70, 46)
        + _arrow(118, 24, 150, 24)
    )


def inertial_drag() -> str:
    """A fast leg throws grains."""
    thrown = [(112, 44), (122, 34), (134, 30), (120, 48), (140, 42), (130, 20), (146, 24)]
    return (
        _bed()
        + _standing(76, 16)
        + _grains(thrown, kind="newgrain")
        + _arrow(104, 58, 118, 40)
        + _arrow(108, 66, 130, 52)
    )


def crater_refill() -> str:
    """A leg lands in the hole of the previous one, into which grains flow back."""
    hole = _crater(80, 24, 16)
    falling = _grains([(64, 56), (69, 63), (92, 63), (97, 56), (74, 70), (87, 70)], kind="newgrain")
    return _bed(hole) + _leg(80, 30, 0) + _hip(80, 30) + falling + _arrow(50, 44, 64, 50) + _arrow(110, 44, 96, 50)


def phi_dependent_response() -> str:
    """Loose and dense ground respond to the leg within different times."""
    halves = f'<path class="ink" d="M80 {SURFACE} V{HEIGHT}"/>'
    dense = _grains(((84 + 11.3 * n % 72, SURFACE + 6 + 7.7 * n % 38) for n in range(60)), kind="grain")
    clocks = "".join(
        f'<circle class="ink" cx="{x}" cy="26" r="15"/><path class="new" d="M{x} 14 V26 l{dx} {dy}"/>'
        for x, dx, dy in ((40, 9, 6), (120, 7, -7))
    )
    return _bed() + dense + halves + clocks


def added_mass() -> str:
    """A cone of grains moves with the leg."""
    cone = f'<path class="new" d="M62 {SURFACE + 17} L98 {SURFACE + 17} L80 {SURFACE + 44} Z"/>'
    inside = _grains([(72, 74), (80, 74), (88, 74), (76, 81), (84, 81), (80, 88)], kind="newgrain")
    return _bed() + _standing(80, 14) + cone + inside


def belly_coast() -> str:
    """The body comes down and slides on."""
    ghost = f'<rect class="was" x="14" y="{SURFACE - 16}" width="72" height="14" rx="5"/>'
    return _bed() + ghost + _body(96, SURFACE - 9, 72) + _arrow(58, 24, 128, 24) + _arrow(124, 66, 92, 66)


def cable_drag() -> str:
    """The cable holds back."""
    return _bed() + _standing(92) + '<path class="was" d="M4 8 Q34 8 52 24"/>' + _arrow(50, 26, 18, 26)


def leg_slip() -> str:
    """A shallow leg slips back through the grains."""
    y = SURFACE + 8 - 2 * RADIUS
    return _bed() + _leg(96, y, 0, "was") + _leg(80, y, 12) + _body(80, y) + _hip(80, y) + _arrow(104, 78, 62, 78)


def resistive_force_theory() -> str:
    """Stress on an element of the leg depends on its tilt and its direction of motion."""
    elements = ""
    for x, y, tilt, to in ((46, 66, 0, (46, 46)), (84, 70, 35, (70, 48)), (122, 74, 70, (100, 62))):
        elements += f'<path class="ink" d="M-11 0 H11" transform="translate({x} {y}) rotate({tilt})"/>' + _arrow(
            x, y, *to
        )
    return _bed() + elements


def dilation() -> str:
    """When disturbed, dense ground dilates and loose ground contracts."""
    out = "".join(
        _arrow(44 + 8 * dx, 72 + 8 * dy, 44 + 21 * dx, 72 + 16 * dy) for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    inward = "".join(
        _arrow(116 + 23 * dx, 72 + 18 * dy, 116 + 9 * dx, 72 + 8 * dy) for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    return _bed(grains=False) + out + inward + _words(22, 40, "dense") + _words(100, 40, "loose")


def cohesion() -> str:
    """Moist grains stick to each other."""
    at = [(56, 70), (72, 64), (88, 71), (104, 65), (64, 85), (81, 86), (98, 84)]
    pairs = ((0, 1), (1, 2), (2, 3), (0, 4), (1, 4), (4, 5), (2, 5), (5, 6), (3, 6), (2, 6))
    bonds = "".join(f'<path class="new" d="M{at[a][0]} {at[a][1]} L{at[b][0]} {at[b][1]}"/>' for a, b in pairs)
    big = "".join(f'<circle class="body" cx="{x}" cy="{y}" r="6"/>' for x, y in at)
    return _bed(grains=False) + _arrow(80, 10, 80, 42, "ink") + bonds + big


def depth_nonlinearity() -> str:
    """Force grows faster, or slower, than depth."""
    straight, bent = ([(28 + 110 * t, 84 - 62 * t**n) for t in (i / 20 for i in range(21))] for n in (1.0, 1.7))
    return _axes("depth", "F") + _curve(straight, "was") + _curve(bent, "new")


def bed_slope() -> str:
    """The bed is not level."""
    robot = _leg(76, 28, 0) + _body(76, 28) + _hip(76, 28)
    level = f'<path class="was" d="M0 {SURFACE + 14} H{WIDTH}"/>'
    return (
        _bed(lambda x: SURFACE + 14 - 0.17 * x)
        + level
        + f'<g transform="rotate(-10 76 60)">{robot}</g>'
        + _arrow(136, 12, 136, 34)
    )


def motor_saturation() -> str:
    """The legs turn slower than commanded."""
    commanded = [(28 + 110 * t, 84 - 62 * t) for t in (i / 20 for i in range(21))]
    turned = [(28 + 110 * t, 84 - 62 * t / math.sqrt(1 + (1.6 * t) ** 2)) for t in (i / 20 for i in range(21))]
    return _axes("set ω", "ω") + _curve(commanded, "was") + _curve(turned, "new")


def phi_nonuniformity() -> str:
    """Denser here, looser there."""
    patches = "".join(
        f'<ellipse class="{kind}" cx="{x}" cy="{y}" rx="{size}" ry="{0.6 * size:.0f}"/>'
        for x, y, size, kind in ((32, 74, 22, "new"), (92, 70, 16, "new"), (132, 84, 18, "new"))
    )
    dense = _grains(((16 + 9.1 * n % 34, 66 + 5.3 * n % 17) for n in range(24)), kind="newgrain")
    more = _grains(((82 + 7.3 * n % 22, 63 + 4.1 * n % 14) for n in range(5)), kind="newgrain")
    return _bed() + patches + dense + more + _leg(62, 18, 0) + _hip(62, 18)


def finite_depth() -> str:
    """The floor of the bed is near."""
    floor = f'<path class="new" d="M0 90 H{WIDTH}"/>'
    hatch = "".join(f'<path class="new" d="M{x} 100 L{x + 10} 90"/>' for x in range(0, WIDTH, 14))
    return _bed() + floor + hatch + _standing(80, 22) + _arrow(80, 88, 80, 77)


def slow_phase_speed() -> str:
    """In its slow phase a leg turns as the clock says, not at the mean rate."""
    dial = '<circle class="ink" cx="80" cy="50" r="38"/>'
    slow = '<path class="new thick" d="M53 77 A38 38 0 0 0 107 77"/>'
    hands = '<path class="was" d="M80 50 L80 18"/><path class="new" d="M80 50 L95 82"/>'
    return dial + slow + hands + _hip(80, 50) + _words(122, 84, "slow")


def carried_momentum() -> str:
    """Between two steps the body does not quite stop."""
    stops, carries = (
        [(28 + 2 * n, 84 - 58 * max(low, abs(math.sin(n * math.pi / 28)))) for n in range(57)] for low in (0.0, 0.28)
    )
    return _axes("time", "v") + _curve(stops, "was") + _curve(carries, "new")


def unequal_leg_load() -> str:
    """The lone leg of a tripod carries more and sinks first."""
    y = SURFACE - 26
    legs = _leg(38, y, 0) + _leg(82, y, 0, "new thick") + _leg(126, y, 0)
    return _bed() + legs + _body(82, y, 120) + _hip(38, y) + _hip(82, y) + _hip(126, y) + _arrow(82, 72, 82, 94)


MOTIFS: dict[str, Callable[[], str]] = {
    motif.__name__: motif
    for motif in (
        disturbed_ground, exact_vertical_acceleration, exact_leg_arc, stance_overlap, swimming_thrust, inertial_drag,
        crater_refill, phi_dependent_response, added_mass, belly_coast, cable_drag, leg_slip, resistive_force_theory,
        dilation, cohesion, depth_nonlinearity, bed_slope, motor_saturation, phi_nonuniformity, finite_depth,
        slow_phase_speed, carried_momentum, unequal_leg_load,
    )
}  # fmt: skip
