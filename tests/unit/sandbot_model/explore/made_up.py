"""Made-up trials and bags: what the explorer's tests share."""

import json
import threading
from dataclasses import replace

import numpy as np
from flask import Flask

from _drawn import table
from sandbot_common import messages, topics
from sandbot_common.serialization import to_cdr
from sandbot_model.explore.pages import serve
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.model import model_of
from sandbot_model.physics.observables import COLUMNS
from sandbot_model.physics.walking import Inputs
from sandbot_record.bags.writer import BagWriter

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}

BOOST = "boost: strength: k*(1 + a*(phi - 0.6)); a [1] in -5..5"


def served(page):
    """A test client of a server with one of the explorer's pages."""
    server = Flask("test")
    serve(server, page.routes)
    return server.test_client()


def suggestions_made():
    """Wait for the discoveries that were asked for."""
    for thread in threading.enumerate():
        if thread.name == "suggest":
            thread.join(60)


def made_up_trials(phis=(0.60, 0.615, 0.633), replicates=2, omegas=(4, 10, 16, 22), columns=COLUMNS, effect=None):
    """Trials with noise, of the base model or with an ``effect`` (name, parameters); only ``columns`` are measured."""
    rng = np.random.default_rng(1)
    phi, omega, replicate = (a.ravel() for a in np.meshgrid(phis, omegas, range(replicates), indexing="ij"))
    k = np.interp(phi, [0.58, 0.60, 0.633], [170, 185, 220])
    name, parameters = effect or ("", {})
    walker = model_of("simple", (name,) if name else (), EFFECTS).walker
    values = walker.predict(Inputs(k, omega, 0.4, phi), [parameters] if name else []).observables
    values = values + rng.normal(0, 1, values.shape) * [0.005, 0.0002, 0.008, 0.002]
    values[:, [column not in columns for column in COLUMNS]] = np.nan
    trials = table(phi + rng.normal(0, 2e-4, len(phi)), omega, replicate, values)
    return replace(trials, trial_id=np.array([f"t{i:02d}" for i in range(len(phi))]))


PACE = 8.0


def walking_bag(path, *, v_x, legs=True, mount=0.0):
    """A second of ``v_x(t)`` at 100 Hz after 0.2 s at rest; the LED goes on as legs start from −π/2 at ``PACE``."""
    start = 1_700_000_000_200_000_000
    with BagWriter(path) as writer:
        writer.write(topics.SYNC_LED, to_cdr(messages.header(start, "sync_led")), start)
        if mount:
            writer.write(topics.TRIAL, to_cdr(messages.string(json.dumps({"leg_mount_rad": mount}))), start)
        for i in range(-20, 100):
            t_ns, t = start + i * 10_000_000, i / 100
            writer.write(topics.SPEED, to_cdr(messages.twist(t_ns, v_x(t), 0.0, 1e-4, 1e-4)), t_ns)
            if legs:
                turned, rate = PACE * max(t, 0.0), PACE * (t >= 0)
                angles = -np.pi / 2 + turned - np.repeat([0.0, np.pi], 3) - mount
                state = messages.joint_state(t_ns, topics.LEGS, angles, np.full(6, rate), np.zeros(6))
                writer.write(topics.LEG_STATES, to_cdr(state), t_ns)
    return path
