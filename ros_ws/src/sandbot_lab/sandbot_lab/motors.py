"""Motors that do not reach the commanded rate, and so lag their set-points by ever more of a turn.

They keep the shape of the set-points' clock signal: a lagging leg is slow and fast at the same angles as its
set-points, and so it remembers the angles at which these last changed their rate.
"""

from math import pi
from typing import Any

from sandbot_lab.jit import jit

JUST_PAST = 1e-9  # rounding may leave a leg this far short of an angle it has reached [rad]
A_MOMENT = 1e-12  # s
NEVER = 1e9  # s


@jit
def note_switches(p: Any, s: Any, span: float, angles: Any, rates: Any) -> None:
    """Remember the angle at which set-points change their rate before the next one: lagging legs will do so there."""
    if not p.motor_saturation:
        return
    for leg in range(2 * p.tripod):
        before, after = s.set_rate[leg], rates[leg]
        if before * after == 0.0:
            s.switch[leg, :, :] = 0.0
        elif before != after:
            at = ((angles[leg] - s.set_angle[leg]) / span - after) / (before - after) * span
            which = 0 if after > before else 1
            s.switch[leg, which, 0] = s.set_angle[leg] + before * min(max(at, 0.0), span)
            s.switch[leg, which, 1], s.switch[leg, which, 2] = before, after


@jit
def own_rate(s: Any, leg: int, rate: float) -> float:
    """The commanded ``rate``, but slow and fast at the angles at which the set-points were."""
    faster, slower = s.switch[leg, 0], s.switch[leg, 1]
    if faster[2] != 0.0 and slower[2] != 0.0:
        return float(faster[2] if since_switch(s, leg, 0) < since_switch(s, leg, 1) else slower[2])
    known = faster if faster[2] != 0.0 else slower
    if known[2] != 0.0:
        return float(known[1] if s.angle[leg] < known[0] - JUST_PAST else known[2])
    return rate


@jit
def since_switch(s: Any, leg: int, which: int) -> float:
    """Angle by which a leg has passed the angle of a switch, 0 to 2 pi."""
    return float((s.angle[leg] - s.switch[leg, which, 0] + JUST_PAST) % (2.0 * pi))


@jit
def next_switch(p: Any, s: Any, leg: int) -> float:
    """Time in which a lagging leg reaches the next such angle at its present rate."""
    when = NEVER
    if p.motor_saturation and s.rate[leg] > 0.0:
        for which in range(2):
            if s.switch[leg, which, 2] != 0.0:
                when = min(when, max((2.0 * pi - since_switch(s, leg, which)) / s.rate[leg], A_MOMENT))
    return when


@jit
def driven_rate(p: Any, s: Any, leg: int, rate: float) -> float:
    """Rate at which a motor turns its leg when commanded to turn at ``rate``."""
    if p.motor_saturation and rate != 0.0:
        rate = own_rate(s, leg, rate)
        return float(rate * saturation(p, rate))
    return rate


@jit
def saturation(p: Any, rate: float) -> float:
    """Ratio of a motor's actual rate to the commanded one."""
    return float(1.0 / (1.0 + (rate / p.motor_saturation_omega_s_rad_s) ** 2) ** 0.5)
