"""The time step: all leg angles in, the body carried along.

The body rests (or slides, or swims) with its belly on the surface while legs sweep down. In each small step the
earliest of three things is located and done: the ground *takes hold* of a sweeping tripod, a sweeping tripod *passes
its lowest point* without that (the robot swims), the body *comes down* at the end of a hold.
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
JUST_PAST = 1e-9  # rounding may carry a leg this far past its lowest point before that is noticed [rad]
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
    """Force of the ground less the load it must bear, when a fraction of the step dt has passed."""
    theta = wrapped(tripod_angle(p, s, tripod) + fraction * dt * tripod_rate(p, s, tripod))
    rate = tripod_rate(p, s, tripod)
    x, z = s.x + s.v * fraction * dt, s.z
    if s.mode == HOLD:
        held = wrapped(tripod_angle(p, s, s.tripod) + fraction * dt * tripod_rate(p, s, s.tripod))
        x, z = held_x(p, s, held), s.centre_z + p.radius * cos(held)
    return force(p, s, theta, rate, x, z, s.t + fraction * dt, s.sweep_k[tripod]) - load(p, s, theta, rate)


@jit
def grip_time(p: Any, s: Any, tripod: int, dt: float) -> float:
    """When within dt the ground takes hold of a searching tripod; beyond dt if it does not."""
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
    """When within dt a searching tripod passes its lowest point; beyond dt if it does not."""
    theta, rate = wrapped(tripod_angle(p, s, tripod)), tripod_rate(p, s, tripod)
    if s.sweep[tripod] != SEARCHING or rate <= 0.0 or theta > JUST_PAST:
        return 2.0 * dt
    return max(-theta, 0.0) / rate


@jit
def touchdown_time(p: Any, s: Any, dt: float) -> float:
    """When within dt the held body is down again; beyond dt if it is not."""
    theta, rate = wrapped(tripod_angle(p, s, s.tripod)), tripod_rate(p, s, s.tripod)
    if s.mode != HOLD or rate == 0.0:
        return 2.0 * dt
    to_go = s.release_angle - theta if rate > 0.0 else s.release_angle + theta
    return float(max(to_go, 0.0) / abs(rate))


@jit
def move(p: Any, s: Any, dt: float) -> None:
    """Carry legs and body on by dt, within which nothing happens."""
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
    """The tripod's leg centres stand still in the ground from now on."""
    theta, rate = wrapped(tripod_angle(p, s, tripod)), tripod_rate(p, s, tripod)
    depth = p.radius * (1.0 + cos(theta)) - s.z
    foot_x = s.x - p.radius * sin(theta)
    if s.steps > 0:
        last_x = s.foot_x[(s.feet - 1) % s.foot_x.size]
        s.pace = (foot_x - last_x) / max(s.t - s.grip_t, 1e-6)
    disturb(s, foot_x, s.t)
    s.grip_t = s.t
    s.bottom_t = 0.0  # strokes that follow a hold are counted anew
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
    """The sweep is over and the ground never held."""
    s.sweep[tripod] = DONE
    if s.mode == HOLD:  # the other tripod carries the body
        return
    mean_rate = 0.5 * (tripod_rate(p, s, 0) + tripod_rate(p, s, 1))
    since = s.t - s.bottom_t
    # Tripods in step pass it at once: nothing is between them.
    s.stroke_rate = pi / since if s.bottom_t > 0.0 and since > ROUNDING_S else mean_rate
    s.bottom_t = s.t
    disturb(s, s.x, s.t)
    s.grip_t = s.t
    s.steps += 1
    s.mode = SWIM
    s.v = swimming_speed(p, s.stroke_rate)


@jit
def come_down(p: Any, s: Any) -> None:
    """The belly is on the surface again."""
    s.mode = REST
    s.z = p.height
    s.v = touchdown_speed(p, s, wrapped(tripod_angle(p, s, s.tripod))) if p.belly_coast else 0.0


@jit
def look_out(p: Any, s: Any) -> None:
    """A tripod that has come forward of its lowest point begins a new sweep; one past it has ended its own."""
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
    """One small step with everything that happens in it, in order."""
    left = dt
    for _ in range(8):
        look_out(p, s)
        first, what, who = left, NOTHING, 0
        for tripod in range(2):
            when = grip_time(p, s, tripod, left)
            if when <= first:
                first, what, who = when, GRIP, tripod
            when = bottom_time(p, s, tripod, left)
            if when < first or (when == first and what == NOTHING):
                first, what, who = when, BOTTOM, tripod
        when = touchdown_time(p, s, left)
        if when < first or (when == first and what == NOTHING):
            first, what = when, TOUCHDOWN
        move(p, s, first)
        left -= first
        if what == GRIP:
            take_hold(p, s, who)
        elif what == BOTTOM:
            pass_bottom(p, s, who)
        elif what == TOUCHDOWN:
            come_down(p, s)
        if left <= 0.0:
            return
    move(p, s, left)


@jit
def switch_time(mean: float, before: float, after: float, span: float) -> float:
    """When within span a leg's rate changes from one set-point's to the next one's, that it come to the mean.

    0 where no such moment is: the leg then turns at the mean rate.
    """
    if before == after:
        return 0.0
    at = (mean - after) / (before - after) * span
    return at if 0.0 < at < span else 0.0


@jit
def turn(p: Any, s: Any, span: float, angles: Any, rates: Any) -> None:
    """Carry the state on by span to the next set-point; a clock that changes from slow to fast does so at a moment."""
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
    """Carry the state on to time t, where the set-points are ``angles`` and ``rates``; the first call only sets out."""
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
    """Write what can be seen of the state into out: x, z, v_x, mode, tripod, then angle, rate, effort of all legs."""
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
    """Torque [N m] at the axle of one leg: ground force at its horizontal lever; legs in the air turn freely."""
    theta, rate = wrapped(tripod_angle(p, s, tripod)), tripod_rate(p, s, tripod)
    if s.mode == HOLD and s.tripod == tripod:
        return float(-load(p, s, theta, 0.0) * p.radius * sin(theta))
    if s.sweep[tripod] == SEARCHING and -0.5 * pi <= theta < 0.0:
        return float(-force(p, s, theta, rate, s.x, s.z, s.t, s.sweep_k[tripod]) * p.radius * sin(theta))
    return 0.0


@jit
def run(physics: Any, state: Any, t: Any, angles: Any, rates: Any, out: Any) -> None:
    """Carry records of shape (1,) through set-points t (n,), angles and rates (n, legs); observe into (n, 5 + 3 legs).

    One row at a time or all at once: the state is the same afterwards.
    """
    p, s = physics[0], state[0]
    for i in range(t.size):
        advance(p, s, t[i], angles[i], rates[i])
        observe(p, s, out[i])
