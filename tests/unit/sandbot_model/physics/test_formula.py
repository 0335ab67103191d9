"""An effect from a line of text: what it does, what is refused, and that threads and processes may share it."""

import gc
import pickle
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandbot_common.errors import InputError
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.effect import STAGES
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.symbols import listed
from sandbot_model.physics.tape import record
from sandbot_model.physics.typeset import mathml_in_pieces
from sandbot_model.physics.walking import Inputs, Walker


def test_a_formula_is_an_effect():
    effect = formula_effect("boost: strength: k*(1 + a*(phi - 0.6)); a [1] in -5..5")
    assert (effect.identifier, effect.stage) == ("boost", "strength")
    assert (effect.parameters[0].low, effect.parameters[0].high) == (-5, 5)
    phi = np.array([0.6, 0.62])
    found = Walker((effect,)).predict(Inputs(200.0, 8.0, 0.4, phi), [{"a": 5.0}]).depth_m
    expected = Walker().predict(Inputs(200.0 * (1 + 5 * (phi - 0.6)), 8.0, 0.4)).depth_m
    np.testing.assert_allclose(found, expected)


@pytest.mark.parametrize(
    ("identifier", "typed"),
    [
        ("exact_vertical_acceleration", "x: balance: a_z -> a_z*s_0/(2*R)"),
        ("stance_overlap", "x: speed: v -> v*(1 - eta); eta [1] in 0..0.25"),
        ("inertial_drag", "x: balance: F_z -> F_z + lambda_1*600*w*R*(R*omega)^2; lambda_1 [1] in 0.5..2"),
        ("phi_dependent_response", "x: balance: Δt = Δt*max(1 + b*(φ − 0.61)/0.05, 0.05); b [1] in -0.5..1"),
        ("cohesion", "x: balance: F_z += 2*c_pa·w·R; c_pa [Pa] in 0..500"),
        ("depth_nonlinearity", "x: balance: F -> F*(z/d_r)^(n - 1); n [1] in 0.8..1.5"),
        ("motor_saturation", "x: clock: ω -> ω/sqrt(1 + (ω/omega_s_rad_s)²); omega_s_rad_s [rad/s] in 30..120"),
        ("finite_depth", "x: strength: k -> k*(1 + exp(-(D - z)/l_m)); l_m [m] in 0.01..0.03"),
        ("leg_slip", "x: step: s, peak *= clip(1 - sigma*(d_r/d)^2, 0, 1); sigma [1] in 0..0.2"),
    ],
)
def test_an_effect_typed_with_the_symbols_that_are_shown_is_that_effect(identifier, typed):
    effect, own = catalogue()[identifier], formula_effect(typed)
    values = {parameter.name: 0.3 * parameter.low + 0.7 * parameter.high for parameter in own.parameters}
    given = Inputs(np.array([[160.0], [210.0]]), np.linspace(4.0, 28.0, 9), 0.4, 0.62)

    def predicted(*effects):
        found = Walker(effects).predict(given, [values] * len(effects))
        return np.stack([found.speed_m_s, found.lift_m, found.peak_speed_m_s, found.first_step_m])

    assert own.stage == effect.stage
    np.testing.assert_allclose(predicted(own), predicted(effect), rtol=1e-9)
    assert not np.allclose(predicted(own), predicted(), rtol=1e-6)


BY_PARTS = (("y", "s *= 1 - a"), ("z", "peak *= 1 - a"))


def test_formulas_after_the_first_change_more_in_turn():
    both = formula_effect("x: step: s *= 1 - a; peak *= s/s_0; a [1] in 0..0.5")
    parts = [formula_effect(f"{name}: step: {what}; a [1] in 0..0.5") for name, what in BY_PARTS]
    here = Inputs(np.array([[160.0], [210.0]]), np.linspace(4.0, 28.0, 9), 0.4, 0.62)
    found, expected, least = (
        Walker(tuple(effects)).predict(here, [{"a": 0.3}] * len(effects)).observables
        for effects in ([both], parts, parts[:1])
    )
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert not np.allclose(found, least)
    assert both.formula == "s -> s * (1 - a); peak -> peak * (s/s_0)"
    assert [one.name for one in both.parameters] == ["a"]


def test_every_symbol_may_be_typed_where_it_exists():
    for symbol in listed():
        stage = symbol.stage if symbol.stage in STAGES else "clock"
        for spelling in symbol.spellings:
            effect = formula_effect(f"x: {stage}: omega = 12 + 0*({spelling})")
            assert np.isfinite(Walker((effect,)).predict(Inputs(200.0, 8.0, 0.4, 0.6), [{}]).speed_m_s)
        assert symbol.unit
        assert symbol.doc


def test_a_parameter_hides_a_symbol_of_its_name():
    k = 1.5 * 200.0
    found = Walker((formula_effect("x: strength: k*a; a [1] in 0..2"),)).predict(Inputs(200.0, 8.0, 0.4), [{"a": 1.5}])
    assert float(found.depth_m) == pytest.approx(float(Walker().predict(Inputs(k, 8.0, 0.4)).depth_m))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x: strength: k*phj", "'phj' is not known at stage strength, did you mean 'phi'?"),
        ("x: strength: k*force", "'force' is not known at stage strength: it exists from stage balance on"),
        ("x: strength: F -> F*2", "'F' can't be set at stage strength: it exists from stage balance on"),
        ("x: strength: k*muh", "a parameter is declared: '; muh [1] in 0..1'"),
        ("x: strenght: k", "no stage 'strenght', did you mean 'strength'?"),
    ],
)
def test_a_name_that_is_none_is_answered_with_the_one_that_may_be_meant(text, said):
    with pytest.raises(InputError) as complaint:
        formula_effect(text)
    assert said in str(complaint.value)


def test_a_formula_may_set_another_quantity():
    effect = formula_effect("brake: balance: extra_force = c*omega; c [N s] in 0..0.1")
    found = Walker((effect,)).predict(Inputs(200.0, 8.0, 0.4), [{"c": 0.05}])
    assert float(found.depth_m) < float(Walker().predict(Inputs(200.0, 8.0, 0.4)).depth_m)


COMPARED = {
    "(d > 0.01) + (d > 0.03)": [0, 1, 2],
    "1 - (d > 0.01)": [1, 0, 0],
    "-(d > 0.01)": [0, -1, -1],
    "(d > 0.01) - (d > 0.03)": [0, 1, 0],
    "exp(d > 0.01)": [1, np.e, np.e],
    "max(d > 0.01, d > 0.03)": [0, 1, 1],
    "sqrt(d > 0.01)": [0, 1, 1],
    "((d > 0.01) & (d < 0.03)) + 2*(~(d > 0.03) | (d < 0.01))": [2, 3, 0],
    "where((d > 0.01) & ~(d > 0.03), 5, 7)": [7, 5, 7],
    "where(d > 0.03, 5, 7)": [7, 7, 5],
    "1 + (2 > 1) + 0*d": [2, 2, 2],
}
"""What comparisons are worth at d = 5, 20 and 40 mm."""


@pytest.mark.parametrize("expression", COMPARED)
def test_a_comparison_is_1_or_0_on_arrays_and_on_a_tape(expression):
    walker, depth = Walker((formula_effect(f"x: strength: k*({expression})"),)), np.array([0.005, 0.02, 0.04])
    found = walker.chain(Inputs(200.0, 10.0, 0.4, 0.6), [{}], depth, first_step=False).k
    np.testing.assert_allclose(found, 200.0 * np.array(COMPARED[expression]), rtol=1e-15)
    assert record(walker) is not None


@pytest.mark.parametrize(
    "late",
    [
        "x: balance: k *= 1 + a*(omega/12 - 1); a in -1..1",
        "x: strength: chord *= 1 + 0*a; a in 0..1",
        "x: balance: chord *= 0.9",
        "x: balance: z -= 0.01",
        "x: speed: kept*(1 - a*(omega < 0)); a in 0..1",
    ],
)
def test_a_formula_that_changes_nothing_is_refused(late):
    with pytest.raises(InputError, match=r"changes nothing: (k|z|kept|chord) stays the same, or is used before"):
        formula_effect(late)


@pytest.mark.parametrize(
    "acting",
    [
        "x: strength: k -> K(phi + c); c in -0.01..0.02",
        "x: strength: k *= 1 + a*(omega > 30)*(phi < 0.57); a in -1..1",
        "x: strength: sigma = s1; s1 in 0..0.01",
        "x: clock: v_swim *= 1 + a; a in -0.5..0.5",
        "x: speed: kept *= 1 - a*first; a in 0..0.5",
        "x: speed: peak *= 1 - a*(d > 0.04); a in 0..0.5",
        "x: balance: m_a = c; c [kg] in 0..0.1",
        "x: balance: d += c; c [m] in 0..0.01",
        "x: strength: k *= 1 + a*maximum(d/R - 1.64, 0); a in 0..1",  # where legs reach deeper than SandBot's
        "x: clock: beta *= 1 + a; a in -0.5..0.5",
        "x: step: s_0 *= 1 + a; a in -0.5..0.5",
    ],
)
def test_a_formula_that_shows_somewhere_or_in_another_effect_is_not_refused(acting):
    assert formula_effect(acting).identifier == "x"


ESCAPES = (
    "().__class__.__bases__[0].__subclasses__()",
    "f'{k.__class__.__init__.__globals__}'",  # CVE-2025-24359: format strings of asteval before 1.0.6
    "'{0.__class__}'.format(k)",
    "k.tofile('x')",
    "sqrt.reduce.__self__",
    "[one for one in (1, 2)]",
    "{one: 1 for one in (1, 2)}",
    "(lambda: 1)()",
    "(k := 1)",
    "k[0]",
    "sqrt(k, out=phi)",
    "sqrt(*(k, phi))",
    "where(phi > [], 1, 2)",
    "k*'a'",
    "k*1j",
    "k*...",
    "k*None",
)
"""By what expressions have reached Python elsewhere; no part of arithmetic."""
BUILT_IN = ("open(1)", "eval(1)", "exec(1)", "getattr(k, k)", "type(k)", "vars()", "print(1)", "numpy(1)")


@pytest.mark.parametrize(
    "text", ["flat: balance: 0.5", "flat: balance: extra_force", "flat: strength: 200", "flat: step: 0.1"]
)
def test_one_number_stands_for_all_depths_and_conditions(text):
    found = Walker((formula_effect(text),)).predict(Inputs(np.array([190.0, 200.0]), 8.0, 0.4), [{}]).observables
    assert found.shape == (2, 4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("boost", "expected 'name: stage: formula"),
        ("Boost: strength: k", "lower-case"),
        ("boost: muscle: k", "no stage 'muscle'; known: clock"),
        ("boost: strength: k*a; a in 5..1", "a in 5..1: low must be below high$"),
        (
            "boost: strength: k*where(a > 1, 1, 2); a in 0..1e400",
            "a in 0..inf: low must be below high, by 1e-100 to 1e100",
        ),
        ("boost: strength: k*a; a from 1 to 5", "is not 'parameter"),
        ("boost: strength: k*unknown", "unknown"),
        ("boost: strength: k*(", "boost"),
        ("boost: strength: force = k", "can't be set at stage strength"),
        ("boost: step: t_s = 0.1", "'t_s' can't be set, it follows from the clock and the step"),
        ("boost: strength: k*a; a in 0..1e300", "low must be below high, by 1e-100 to 1e100"),
        ("boost: strength: k*a; a in 0..1e-300", "low must be below high, by 1e-100 to 1e100"),
        *(
            (f"boost: speed: kept *= 1 - {name}; {name} in 0..1", "choose another name")
            for name in ("phi", "R", "delta_v", "pi", "sin", "max")
        ),
        *(
            (f"boost: {stage}: {name} *= 1 - {other}; {other} in 0..1", f"'{other}' is a quantity that is set, choose")
            for stage, name, other in (("step", "s", "s"), ("step", "chord, step", "s"), ("speed", "peak", "peak"))
        ),
        ("boost: speed: kept *= 1 - a; a in 0..0.5; b in 0..1; a in 0..0.25", "parameter 'a' is declared twice"),
        ("boost: strength: k*first; first in 0..1", "choose another name"),
        ("boost: speed: kept, k2 *= 1 + a; a in 0..1", "'k2' can't be set at stage speed"),
        ("boost: speed: kept %= a; a in 0..1", "boost"),
        ("boost: step: s *= 0.9; peek *= 1.1", "'peek' can't be set at stage step, did you mean 'peak'?"),
        ("boost: step: s *= 0.9; peak *= 1 +", "'1 \\+' is not an expression"),
        ("boost: step: s*(1 + 2 first)", r"at '1 \+ 2 first\)'"),
        ("boost: strength: phi += 0.01", r"k does not follow 'phi'; k -> K\(phi \+ ...\)"),
        ("boost: speed: kept*sqrt(-1)", "gives no number at k 200 N/m, ω 10 rad/s"),
        ("boost: strength: k == 3", "'k == 3' gives values of type bool, expected numbers"),
        ("boost: strength: (d > 0.01) & (d < 0.03)", "values of type bool"),
        ("boost: strength: k*logistic(phi)", "no function 'logistic'; known: K, abs"),
        ("boost: strength: k*sinn(phi)", "no function 'sinn', did you mean 'sin'?"),
        ("boost: strength: __import__('os').system('true')", "boost"),
        ("boost: strength: open('/etc/passwd').read()", "boost"),
        ("boost: strength: k.__class__.__bases__", "boost"),
        ("boost: strength: k*sqrt()", r"sqrt\(\) takes 1 value, not 0"),
        ("boost: strength: k*min(1, 2, 3)", r"min\(\) takes 2 values, not 3"),
        ("boost: strength: k*(2 if phi > .6 else 1)", r"lambda; 'a if b else c' is where\(b, a, c\)"),
        ("boost: strength: k*(phi - 0,6)", "lambda; decimals have a point, no comma"),
        *((f"boost: strength: {escape}", "only names, numbers, operators and functions") for escape in ESCAPES),
        *((f"boost: strength: k*{name}", f"no function '{name.split('(')[0]}'") for name in BUILT_IN),
        *((f"boost: strength: {writing}", "takes 1 value, not 2") for writing in ("sqrt(k, phi)", "abs(k, k)")),
    ],
)
def test_refuses_formulas_that_do_not_fit(text, message):
    with pytest.raises(InputError, match=message) as raised:
        formula_effect(text)
    assert "\n" not in str(raised.value)


@pytest.fixture
def hasty_threads():
    """Threads that take turns a thousand times more often than usual."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(5e-6)
    yield
    sys.setswitchinterval(usual)


def test_a_formula_effect_is_used_by_threads_at_once(hasty_threads):
    """As the explorer does, whose page asks again before it has been answered."""
    walker = Walker((formula_effect("boost: strength: k*a + 0*phi; a in 0.5..2"),))

    def depths(count):
        k = np.linspace(150.0, 250.0, count)
        given = Inputs(k, 8.0, 0.4, np.full(count, 0.6))
        return [walker.predict(given, [{"a": 1.2}]).depth_m for _ in range(60)]

    with ThreadPoolExecutor(4) as threads:
        for count, found in zip((3, 40, 7, 100), threads.map(depths, (3, 40, 7, 100)), strict=True):
            expected = Walker().predict(Inputs(1.2 * np.linspace(150.0, 250.0, count), 8.0, 0.4)).depth_m
            np.testing.assert_allclose(found, [expected] * 60)


def test_a_formula_is_parsed_once(monkeypatch):
    """Parsing is not safe in threads (CPython issue 106905), evaluating is."""
    walker = Walker((formula_effect("boost: strength: k*a; a in 0.5..2"),))
    monkeypatch.setattr("ast.parse", None)
    walker.predict(Inputs(200.0, 8.0, 0.4), [{"a": 1.1}])


class Straggler:
    """Garbage whose end gives other threads a turn, wherever it is collected."""

    def __init__(self):
        self.itself = self

    def __del__(self):
        for _ in range(300):
            pass


@pytest.mark.slow
def test_formulas_are_parsed_by_threads_at_once(hasty_threads):
    """As the explorer does, which reads the address's formulas, and typesets those of its effects, in each of its
    threads."""
    usual = gc.get_threshold()
    gc.set_threshold(20)

    def parse_many(_):
        for _ in range(300):
            Straggler()
            formula_effect("boost: strength: k*(1 + a*(phi - (0.6 + 0*(k - 1)))); a in 0.5..2")
            mathml_in_pieces("k -> k*(1 + a*(phi - (0.6 + 0*(k - 1))))")

    try:
        with ThreadPoolExecutor(4) as threads:
            list(threads.map(parse_many, range(4)))
    finally:
        gc.set_threshold(*usual)


@pytest.mark.parametrize("formula", ["k*exp(a)", "k*a"])
def test_ctrl_c_in_the_middle_of_a_formula_is_ctrl_c(formula):
    class Interrupted:
        __array_ufunc__ = None

        def __rmul__(self, _):
            raise KeyboardInterrupt

    def interrupted(_):
        raise KeyboardInterrupt

    effect = formula_effect(f"boost: strength: {formula}; a in 0..1")
    interpreter = effect._each_thread.interpreter
    interpreter.symtable["exp"] = interrupted
    chain = Walker().chain(Inputs(200.0, 8.0, 0.4), (), np.array([0.02]), first_step=False)
    with pytest.raises(KeyboardInterrupt):
        effect.apply(chain, {"a": Interrupted()})


def test_a_formula_effect_travels_between_processes():
    effect = formula_effect("boost: strength: k*a; a in 0.5..2")
    effect = pickle.loads(pickle.dumps(effect))
    found = Walker((effect,)).predict(Inputs(200.0, 8.0, 0.4), [{"a": 1.1}])
    assert float(found.depth_m) == pytest.approx(float(Walker().predict(Inputs(220.0, 8.0, 0.4)).depth_m))


def test_each_formula_is_an_effect_of_its_own():
    one, other = formula_effect("one: strength: k*a; a in 0.5..2"), formula_effect("two: balance: force*first")
    assert (one.identifier, one.stage, len(one.parameters), one.first_step_differs) == ("one", "strength", 1, False)
    assert (other.identifier, other.stage, other.parameters, other.first_step_differs) == ("two", "balance", (), True)
    assert one.formula == "k -> k*a"


@given(st.sampled_from([1.5, 2.0, 3.0]), st.sampled_from("*/+-"))
def test_a_change_in_place_is_the_assignment_written_out(value, how):
    short = formula_effect(f"one: strength: k {how}= {value}")
    long = formula_effect(f"one: strength: k = k {how} {value}")
    found = [Walker((effect,)).predict(Inputs(190.0, 8.0, 0.4), [{}]).observables for effect in (short, long)]
    np.testing.assert_array_equal(*found)


PARTS = [*"k=*+(),;a", "boost", ":", "strength", "balance", "1e400", "first", " in ", "0..1", "\n", "[N]"]


@given(st.text(max_size=40) | st.lists(st.sampled_from(PARTS), max_size=14).map("".join))
def test_any_text_is_an_effect_or_one_line(text):
    said = ""
    try:
        assert formula_effect(text).identifier in text
    except InputError as error:
        said = str(error)
    assert "\n" not in said
