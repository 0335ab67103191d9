"""Each effect's formula says what its ``apply`` does: both are evaluated, on the chain as the effect finds it."""

import copy
import math
import operator
import re
from dataclasses import dataclass, fields
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from sandbot_common.robot import SANDBOT
from sandbot_model.physics.catalogue import describe
from sandbot_model.physics.chain import Chain
from sandbot_model.physics.effect import Effect
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.effects.resistive_force_theory import A00, A10, B01, B11, B_11
from sandbot_model.physics.gait import clock
from sandbot_model.physics.geometry import deepest_m
from sandbot_model.physics.typeset import mathml, mathml_in_pieces, mathml_lines, plain, statements
from sandbot_model.physics.walking import Inputs, KCurve, Walker

EFFECTS = {effect.identifier: effect for effect in CATALOGUE}
EACH = pytest.mark.parametrize("name", EFFECTS)
DEPTH = np.linspace(2e-3, deepest_m(SANDBOT) - 1e-3, 12)
CURVE = KCurve(np.array([0.56, 0.6, 0.65]), np.array([160.0, 205.0, 230.0]))
OF_CHAIN = {
    "k": "k", "omega": "omega", "phi": "phi", "Delta_t": "delta_t", "v_swim": "v_swim", "beta": "slow_phase_ratio",
    "beta_swing": "swing_ratio", "d_slow": "slow_begin", "d_end": "slow_end",
    "d": "depth", "s_0": "chord", "s": "step", "a": "advance", "z": "penetration", "sigma": "sigma_phi", "F": "force",
    "Delta_v": "delta_v", "m_a": "added_mass", "g": "gravity", "v": "speed", "peak": "peak_ratio", "K": "k_of_phi",
    "t_s": "standing_time", "t_left": "time_left",
}  # fmt: skip
DERIVED = {
    "F_z": lambda chain: chain.force + chain.extra_force,
    "a_z": lambda chain: chain.delta_v / chain.delta_t * chain.lift_ratio,
    "first": lambda chain: float(chain.first_step),
}
OF_ROBOT = {
    "R": "leg_radius_m", "h": "axle_height_m", "w": "leg_width_m", "m": "mass_per_leg_kg", "g": "gravity_m_s2",
    "D": "bed_depth_m", "N": "legs_per_tripod", "d_r": "stiffness_depth_m", "Delta_xi": "arc_excess_rad",
}  # fmt: skip
SET_BY = {"v": "kept", "F_z": "extra_force", "a_z": "lift_ratio"}
"""What ``apply`` sets where the formula speaks of what follows from it."""
FUNCTIONS = {
    "max": np.maximum, "min": np.minimum, "clip": np.clip, "exp": np.exp, "sqrt": np.sqrt, "hypot": np.hypot,
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "acos": lambda x: np.arccos(np.clip(x, -1, 1)),
    "asin": lambda x: np.arcsin(np.clip(x, -1, 1)), "where": np.where, "pi": np.pi,
}  # fmt: skip
INTEGRATED = {"resistive_force_theory": 0.01}
"""Effects whose formula is an integral, with the relative error that their tables may have."""


class Spy(Effect):
    """An effect that keeps the chain as it was before and after."""

    def __init__(self, effect):
        self.effect, self.stage = effect, effect.stage

    def apply(self, chain, p):
        self.before = copy.copy(chain)
        self.effect.apply(chain, p)
        self.after = copy.copy(chain)


def force_over_depth(depths):
    """∫ α_z z dA over z, by quadrature: a leg about its axle, the belly on the ground, its lowest point at a depth."""
    radius, axle = SANDBOT.leg_radius_m, SANDBOT.axle_height_m

    def one(depth):
        ahead = math.sqrt(radius**2 - (depth + axle - radius) ** 2) if depth + axle < 2 * radius else 0.0
        tip = math.acos(max(-1.0, min(1.0, (depth + axle) / radius - 1))) + SANDBOT.arc_excess_rad

        def stress(psi):
            x, z = ahead + radius * math.sin(psi), radius * (1 - math.cos(psi)) - depth
            gamma = math.atan2(x, z - axle)
            beta = -(math.remainder(psi, math.pi))
            waves = A00 + A10 * math.cos(2 * beta) + B11 * math.sin(2 * beta + gamma)
            return -z * (waves + B01 * math.sin(gamma) + B_11 * math.sin(gamma - 2 * beta))

        surface = math.acos(1 - depth / radius)
        return quad(stress, -min(surface, tip), surface, limit=200)[0] / depth

    return np.vectorize(one)(depths)


class Names(dict):
    """What a name in a formula stands for: a parameter, a definition, a function, a quantity, a number of the robot."""

    def __init__(self, effect, chain, p):
        super().__init__(FUNCTIONS, f=force_over_depth)
        self.update({one.symbol or one.name: p[one.name] for one in effect.parameters})
        self.chain = chain
        self.definitions = {one.left: one.right for one in statements(effect.formula)[0] if one.how == "="}

    def __missing__(self, name):
        if name in self.definitions:
            return self.value(self.definitions[name])
        for left, right in self.definitions.items():
            if left.startswith(f"{name}("):
                argument = left[len(name) + 1 : -1]
                return lambda value: eval(right, {"__builtins__": {}}, Nested(self, {argument: value}))
        if name in DERIVED:
            return DERIVED[name](self.chain)
        if hasattr(self.chain, OF_CHAIN.get(name, "?")):
            return getattr(self.chain, OF_CHAIN[name])
        return getattr(self.chain.robot, OF_ROBOT[name])

    def value(self, expression):
        return eval(expression, {"__builtins__": {}}, self)


class Nested(dict):
    def __init__(self, outer, own):
        super().__init__(own)
        self.outer = outer

    def __missing__(self, name):
        return self.outer[name]


@dataclass
class Comparison:
    """Of every quantity that the formula changes, or that apply does: what each says."""

    said: dict
    done: dict

    def agrees(self, tolerance):
        return self.said.keys() == self.done.keys() and all(
            np.allclose(np.broadcast_arrays(said, done)[0], done, rtol=tolerance, atol=1e-12)
            for said, done in zip(self.said.values(), (self.done[name] for name in self.said), strict=True)
        )


def compare(effect, shares, *, first=False, phi=0.61):
    """The formula's change beside ``apply``'s, parameters that share of the way through their ranges."""
    p = {
        one.name: np.asarray([one.low + share * (one.high - one.low)])
        for one, share in zip(effect.parameters, shares, strict=False)
    }
    spy = Spy(effect)
    inputs = Inputs(np.array([[190.0], [215.0]]), 13.0, 0.4, phi, 0.02, clock(["SGCS"])[0], CURVE)
    Walker((spy,)).chain(inputs, [p], DEPTH, first_step=first)
    said, words = statements(effect.formula)
    names = Names(effect, spy.before, p)
    changes = {} if first and words == "not in the first step" else {
        one.left: names.value(one.right) for one in said if one.how == "->"
    }  # fmt: skip
    after = Names(replace_formula(effect, "x -> x"), spy.after, p)
    done = {name: after[name] for name in changes}
    for field in fields(Chain):
        at = operator.attrgetter(field.name)
        known = hasattr(spy.before, field.name)
        if known and at(spy.before) is not at(spy.after) and not np.array_equal(at(spy.before), at(spy.after)):
            symbols = [symbol for symbol in OF_CHAIN if OF_CHAIN[symbol] == field.name and symbol in changes]
            symbols += [symbol for symbol in changes if SET_BY.get(symbol) == field.name]
            if not symbols:
                done[field.name] = at(spy.after)
    return Comparison(changes, done)


def replace_formula(effect, formula):
    other = copy.copy(effect)
    other.formula = formula
    return other


@EACH
@settings(max_examples=12, deadline=None)
@given(st.lists(st.floats(0, 1), min_size=2, max_size=2), st.booleans(), st.sampled_from([0.585, 0.61, 0.63]))
def test_the_formula_says_what_apply_does(name, shares, first, phi):
    assert compare(EFFECTS[name], shares, first=first, phi=phi).agrees(INTEGRATED.get(name, 1e-9))


@EACH
def test_a_formula_that_is_off_by_five_per_cent_is_noticed(name):
    wrong = re.sub(r"-> ([^;:]*)", r"-> 1.05*(\1)", EFFECTS[name].formula, count=1)
    assert not compare(replace_formula(EFFECTS[name], wrong), (0.5, 0.5)).agrees(INTEGRATED.get(name, 1e-9))


@pytest.mark.parametrize("name", [name for name, one in EFFECTS.items() if "; peak" in one.formula])
def test_a_quantity_that_is_left_out_is_noticed(name):
    wrong = "; ".join(part for part in EFFECTS[name].formula.split("; ") if not part.startswith("peak"))
    assert not compare(replace_formula(EFFECTS[name], wrong), (0.9, 0.9)).agrees(1e-9)


@pytest.mark.parametrize("name", [name for name, one in EFFECTS.items() if "not in the first step" in one.formula])
def test_a_first_step_that_is_left_out_is_noticed(name):
    wrong = EFFECTS[name].formula.partition(":")[0]
    assert not compare(replace_formula(EFFECTS[name], wrong), (0.9, 0.9), first=True).agrees(1e-9)


@EACH
def test_it_is_typeset(name):
    """Well-formed, and every parameter is in it."""
    effect = EFFECTS[name]
    shown = ElementTree.fromstring(mathml(effect.formula))
    assert shown.tag == "math"
    assert shown.find(".//mi") is not None
    letters = "".join(one.text or "" for one in shown.iter() if one.tag != "mtext")
    assert not any(sign in letters for sign in ("omega", "_", "->", "*", "^"))
    for one in effect.parameters:
        symbol = mathml(f"{one.symbol or one.name} = 1").removeprefix("<math>").partition("<mo>")[0]
        assert symbol in mathml(effect.formula)


def test_a_choice_in_a_product_or_a_choice_has_parentheses():
    def shown(formula):
        return "".join(ElementTree.fromstring(mathml(formula)).itertext()).replace("\u00a0", " ")

    assert shown("k -> k*where(d > 1, 2, 3)") == "k→k\u2062(2 if d>1, else 3)"
    assert shown("k -> where(d > 1, where(d > 2, 4, 5), 3)") == "k→(4 if d>2, else 5) if d>1, else 3"
    assert shown("k -> where(d > 1, 2*d, 3)") == "k→2\u2062d if d>1, else 3"


@pytest.mark.parametrize(
    ("formula", "shown"),
    [
        ("v -> v*e*s_0", "v→v\u2062e\u2062s0"),
        ("peak -> peak*e", "peak→peak·e"),
        ("g -> 2*g*cos(chi)", "g→2\u2062g·cos\u2061(χ)"),
        ("v -> e*peak^2*k", "v→e·peak2·k"),
        ("v -> k*sqrt(2)*v*2", "v→k\u20622\u2062v·2"),
        ("Delta_v -> Delta_v*b", "Δv→Δv·b"),
    ],
)
def test_words_functions_and_numbers_do_not_run_into_the_factor_beside(formula, shown):
    assert "".join(ElementTree.fromstring(mathml(formula)).itertext()) == shown


def test_words_after_a_formula_stand_apart_from_it():
    assert "".join(ElementTree.fromstring(mathml("s -> s*e: not in the first step")).itertext()).endswith(
        "e,\u00a0not in the first step"
    )


@EACH
def test_each_statement_has_its_line_and_the_words_have_one(name):
    formula = EFFECTS[name].formula
    found, words = statements(formula)
    lines = mathml_lines(formula)
    assert len(lines) == len(found) + bool(words)
    assert all(ElementTree.fromstring(line).tag == "math" for line in lines[: len(found)])


def test_words_of_a_user_are_shown_as_they_are():
    assert mathml("k (1 + a (omega/12 - 1)) <b>") == "<math><mtext>k (1 + a (omega/12 - 1)) &lt;b&gt;</mtext></math>"


def test_sums_in_products_keep_their_parentheses():
    assert "".join(ElementTree.fromstring(mathml("k -> (k + 1)*(2 - (3 - z))")).itertext()) == "k→(k+1)\u2062(2−(3−z))"


def test_the_catalogue_carries_it():
    assert describe(EFFECTS)[0]["typeset"].startswith("<math><mi>k</mi><mo>→</mo>")


@EACH
def test_in_pieces_it_says_the_same(name):
    formula = EFFECTS[name].formula
    pieces = ElementTree.fromstring(f"<span>{mathml_in_pieces(formula)}</span>")
    lines, words = statements(formula)
    assert len(pieces.findall("math")) == len(lines)
    whole = ElementTree.fromstring(mathml(formula))
    assert "".join("".join(pieces.itertext()).split()) == "".join("".join(whole.itertext()).split())
    assert (pieces[-1].tail or "").removeprefix(", ") == plain(words)


def test_words_in_pieces_are_no_markup():
    assert mathml_in_pieces("k (1 + a) <b>") == "k (1 + a) &lt;b&gt;"
