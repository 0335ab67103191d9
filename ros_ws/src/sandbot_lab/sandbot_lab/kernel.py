"""The time step: leg angles in, body motion out.

The body rests (or slides, or swims) with its belly on the surface while legs sweep down. In each small step the
earliest of three events is located and carried out: the ground *takes hold* of a sweeping tripod, a sweeping tripod
*passes its lowest point* without that (the robot swims), the body *comes down* at the end of a hold.
"""

from math import acos, ceil, cos, pi, sin
from typing import Any

from sandbot_lab.ground import disturb, force
from sandbot_lab.jit import jit
from sandbot_lab.motors import driven_rate, next_switch, note_switches
from sandbot_lab.stance import (
    advance_gain,
    coasting_deceleration,
    held_speed,
    held_x,
    load,
    stop_angle,
    swimming_speed,
    touchdown_speed,
)

SUB_STEP = 0.5e-3  # longest step [s]
BISECTIONS = 24
ROUNDING_S = 1e-12
JUST_PAST = 1e-9  # rounding may carry a leg this far past its lowest point before it is detected [rad]
REST, HOLD, SWIM = 0, 1, 2
IDLE, SEARCHING, DONE = 0, 1, 2  # a tripod's sweep
NOTHING, GRIP, BOTTOM, TOUCHDOWN = 0, 1, 2, 3


@jit
def wrapped(angle: float) -> float:
    """The angle in [-pi, pi)."""
    return (angle + pi) % (2.0 * pi) - pi


@jit
def tripod_angle(p: Any, s: Any, tripod: int) -> float:
    """Mean centre angle of a tripod's legs."""
    total = 0.0
    for leg in range(tripod * p.tripod, (tripod + 1) * p.tripod):
        total += s.angle[leg]
    return float(total / p.tripod + p.mount)


@jit
def tripod_rate(p: Any, s: Any, tripod: int) -> float:
    """Mean rate of a tripod's legs."""
    total = 0.0
    for leg in range(tripod * p.tripod, (tripod + 1) * p.tripod):
        total += s.rate[leg]
    return float(total / p.tripod)


@jit
def margin(p: Any, s: Any, tripod: int, fraction: float, dt: float) -> float:
    """Force of the ground minus the load it must bear, after a fraction of the step dt."""
    theta = wrapped(tripod_angle(p, s, tripod) + fraction * dt * tripod_rate(p, s, tripod))
    rate = tripod_rate(p, s, tripod)
    x, z = s.x + s.v * fraction * dt, s.z
    if s.mode == HOLD:
        held = wrapped(tripod_angle(p, s, s.tripod) + fraction * dt * tripod_rate(p, s, s.tripod))
        x, z = held_x(p, s, held), s.centre_z + p.radius * cos(held)
    return force(p, s, theta, rate, x, z, s.t + fraction * dt, s.sweep_k[tripod]) - load(p, s, theta, rate)


@jit
def grip_time(p: Any, s: Any, tripod: int, dt: float) -> float:
    """Time within dt at which the ground takes hold of a searching tripod; beyond dt if it does not."""
    start = wrapped(tripod_angle(p, s, tripod))
    rate = tripod_rate(p, s, tripod)
    if s.sweep[tripod] != SEARCHING or rate <= 0.0 or start >= 0.0:
        return 2.0 * dt
    # Not beyond the lowest point: there the sweep is over.
    last = min(1.0, -start / (rate * dt))
    if margin(p, s, tripod, 0.0, dt) >= 0.0:
        return 0.0
    if margin(p, s, tripod, last, dt) < 0.0:
        return 2.0 * dt
    low, high = 0.0, last
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if margin(p, s, tripod, middle, dt) < 0.0:
            low = middle
        else:
            high = middle
    return high * dt


@jit
def bottom_time(p: Any, s: Any, tripod: int, dt: float) -> float:
    """Time within dt at which a searching tripod passes its lowest point; beyond dt if it does not."""
    theta, rate = wrapped(tripod_angle(p, s, tripod)), tripod_rate(p, s, tripod)
    if s.sweep[tripod] != SEARCHING or rate <= 0.0 or theta > JUST_PAST:
        return 2.0 * dt
    return max(-theta, 0.0) / rate


@jit
def touchdown_time(p: Any, s: Any, dt: float) -> float:
    """Time within dt at which the held body is down again; beyond dt if it is not."""
    theta, rate = wrapped(tripod_angle(p, s, s.tripod)), tripod_rate(p, s, s.tripod)
    if s.mode != HOLD or rate == 0.0:
        return 2.0 * dt
    to_go = s.release_angle - theta if rate > 0.0 else s.release_angle + theta
    return float(max(to_go, 0.0) / abs(rate))


@jit
def move(p: Any, s: Any, dt: float) -> None:
    """Advance legs and body by dt, in which no event occurs."""
    for leg in range(2 * p.tripod):
        s.angle[leg] += s.rate[leg] * dt
        s.turned += s.rate[leg] * dt / (2 * p.tripod)
    s.t += dt
    moving = abs(tripod_rate(p, s, 0)) + abs(tripod_rate(p, s, 1)) > 1e-9
    if moving:
        s.drift += p.speed_offset * dt
    if s.mode == HOLD:
        theta, rate = wrapped(tripod_angle(p, s, s.tripod)), tripod_rate(p, s, s.tripod)
        s.x, s.z = held_x(p, s, theta), s.centre_z + p.radius * cos(theta)
        s.v = held_speed(p, s, theta, rate)
    elif s.mode == SWIM:
        s.v = swimming_speed(p, s.stroke_rate) if moving else 0.0
        s.x += s.v * dt
    elif p.belly_coast and s.v > 0.0:
        moving_s = min(dt, s.v / coasting_deceleration(p))  # until it stops, not until the step ends
        slower = s.v - coasting_deceleration(p) * moving_s
        s.x += 0.5 * (s.v + slower) * moving_s
        s.v = slower


@jit
def take_hold(p: Any, s: Any, tripod: int) -> None:
    """Begin a hold: the tripod's leg centres are fixed in the ground from now on."""
    theta, rate = wrapped(tripod_angle(p, s, tripod)), tripod_rate(p, s, tripod)
    depth = p.radius * (1.0 + cos(theta)) - s.z
    foot_x = s.x - p.radius * sin(theta)
    if s.steps > 0:
        last_x = s.foot_x[(s.feet - 1) % s.foot_x.size]
        s.pace = (foot_x - last_x) / max(s.t - s.grip_t, 1e-6)
    disturb(s, foot_x, s.t)
    s.grip_t = s.t
    s.bottom_t = 0.0  # the first stroke after a hold has no predecessor
    s.steps += 1
    s.sweep[tripod] = DONE
    s.mode, s.tripod = HOLD, tripod
    s.grip_angle, s.grip_x = theta, s.x
    s.centre_z = s.z - p.radius * cos(theta)
    s.release_angle = acos(min(max((p.height - s.centre_z) / p.radius, -1.0), 1.0))
    s.stop_angle = stop_angle(p, theta, s.release_angle)
    s.gain = advance_gain(p, depth, rate)
    s.v = held_speed(p, s, theta, rate)


@jit
def pass_bottom(p: Any, s: Any, tripod: int) -> None:
    """End a sweep in which the ground never held."""
    s.sweep[tripod] = DONE
    if s.mode == HOLD:  # the other tripod carries the body
        return
    mean_rate = 0.5 * (tripod_rate(p, s, 0) + tripod_rate(p, s, 1))
    since = s.t - s.bottom_t
    # If the tripods move in step they pass it simultaneously, with no time in between.
    s.stroke_rate = pi / since if s.bottom_t > 0.0 and since > ROUNDING_S else mean_rate
    s.bottom_t = s.t
    disturb(s, s.x, s.t)
    s.grip_t = s.t
    s.steps += 1
    s.mode = SWIM
    s.v = swimming_speed(p, s.stroke_rate)


@jit
def come_down(p: Any, s: Any) -> None:
    """End a hold: the belly is on the surface again."""
    s.mode = REST
    s.z = p.height
    s.v = touchdown_speed(p, s, wrapped(tripod_angle(p, s, s.tripod))) if p.belly_coast else 0.0


@jit
def update_sweeps(p: Any, s: Any) -> None:
    """Begin a sweep for a tripod that is ahead of its lowest point; end that of a tripod past it."""
    for tripod in range(2):
        theta = wrapped(tripod_angle(p, s, tripod))
        ahead = -0.5 * pi <= theta < 0.0
        if ahead and s.sweep[tripod] == IDLE:
            s.sweep[tripod] = SEARCHING
            s.sweep_k[tripod] = p.k_sweep[s.sweeps % p.k_sweep.size]
            s.sweeps += 1
        elif not ahead and (s.sweep[tripod] == DONE or not 0.0 <= theta <= JUST_PAST):
            s.sweep[tripod] = IDLE


@jit
def sub_step(p: Any, s: Any, dt: float) -> None:
    """One small step with all its events in order."""
    remaining = dt
    for _ in range(8):
        update_sweeps(p, s)
        first, event, which = remaining, NOTHING, 0
        for tripod in range(2):
            when = grip_time(p, s, tripod, remaining)
            if when <= first:
                first, event, which = when, GRIP, tripod
            when = bottom_time(p, s, tripod, remaining)
            if when < first or (when == first and event == NOTHING):
                first, event, which = when, BOTTOM, tripod
        when = touchdown_time(p, s, remaining)
        if when < first or (when == first and event == NOTHING):
            first, event = when, TOUCHDOWN
        move(p, s, first)
        remaining -= first
        if event == GRIP:
            take_hold(p, s, which)
        elif event == BOTTOM:
            pass_bottom(p, s, which)
        elif event == TOUCHDOWN:
            come_down(p, s)
        if remaining <= 0.0:
            return
    move(p, s, remaining)


@jit
def switch_time(mean: float, before: float, after: float, span: float) -> float:
    """Time within span at which a leg must switch from one set-point's rate to the next one's to turn at ``mean``
    on average; 0 if there is none, and the leg then turns at the mean rate.
    """
    if before == after:
        return 0.0
    at = (mean - after) / (before - after) * span
    return at if 0.0 < at < span else 0.0


@jit
def turn(p: Any, s: Any, span: float, angles: Any, rates: Any) -> None:
    """Advance the state by span to the next set-point; changes between slow and fast phase are instantaneous."""
    note_switches(p, s, span, angles, rates)
    done = 0.0
    while done < span - ROUNDING_S:
        until = span
        for leg in range(2 * p.tripod):
            mean = (angles[leg] - s.set_angle[leg]) / span
            at = switch_time(mean, s.set_rate[leg], rates[leg], span)
            rate = mean
            if at > 0.0:
                rate = rates[leg] if done >= at - ROUNDING_S else s.set_rate[leg]
                if done < at - ROUNDING_S:
                    until = min(until, at)
            s.rate[leg] = driven_rate(p, s, leg, rate)
            until = min(until, done + next_switch(p, s, leg))
        steps = max(ceil((until - done) / SUB_STEP - 1e-6), 1)
        for _ in range(steps):
            sub_step(p, s, (until - done) / steps)
        done = until


@jit
def advance(p: Any, s: Any, t: float, angles: Any, rates: Any) -> None:
    """Advance the state to time t with set-points ``angles`` and ``rates``; the first call only sets the start."""
    if not s.started:
        s.started, s.t = True, t
        for leg in range(2 * p.tripod):
            s.angle[leg] = angles[leg]
    else:
        span = t - s.t
        if span > 0.0:
            turn(p, s, span, angles, rates)
            s.t = t
    for leg in range(2 * p.tripod):
        s.set_angle[leg], s.set_rate[leg] = angles[leg], rates[leg]
        s.rate[leg] = driven_rate(p, s, leg, rates[leg])


@jit
def observe(p: Any, s: Any, out: Any) -> None:
    """Write the observable state into out: x, z, v_x, mode, tripod, then angle, rate, effort of all legs."""
    first_step = p.first_step_offset * min(s.turned / pi, 1.0)
    moving = abs(tripod_rate(p, s, 0)) + abs(tripod_rate(p, s, 1)) > 1e-9
    out[0] = s.x + s.drift + first_step
    out[1] = s.z
    out[2] = s.v + (p.speed_offset if moving else 0.0)
    out[3] = s.mode
    out[4] = s.tripod if s.mode == HOLD else -1
    if s.mode == HOLD:
        theta = wrapped(tripod_angle(p, s, s.tripod))
        lowest = cos(s.release_angle)
        if lowest < 1.0:
            out[1] += p.lift_offset * (cos(theta) - lowest) / (1.0 - lowest)
    for leg in range(2 * p.tripod):
        out[5 + leg], out[5 + 2 * p.tripod + leg] = s.angle[leg], s.rate[leg]
        out[5 + 4 * p.tripod + leg] = effort(p, s, leg // p.tripod)


@jit
def effort(p: Any, s: Any, tripod: int) -> float:
    """Torque [N m] at the axle of one leg: ground force times its horizontal lever arm; legs in the air turn freely."""
    theta, rate = wrapped(tripod_angle(p, s, tripod)), tripod_rate(p, s, tripod)
    if s.mode == HOLD and s.tripod == tripod:
        return float(-load(p, s, theta, 0.0) * p.radius * sin(theta))
    if s.sweep[tripod] == SEARCHING and -0.5 * pi <= theta < 0.0:
        return float(-force(p, s, theta, rate, s.x, s.z, s.t, s.sweep_k[tripod]) * p.radius * sin(theta))
    return 0.0


@jit
def run(physics: Any, state: Any, t: Any, angles: Any, rates: Any, out: Any) -> None:
    """Run records of shape (1,) through set-points t (n,), angles and rates (n, legs); observe into (n, 5 + 3 legs).

    Calling it row by row or with all rows at once gives the same state.
    """
    p, s = physics[0], state[0]
    for i in range(t.size):
        advance(p, s, t[i], angles[i], rates[i])
        observe(p, s, out[i])
