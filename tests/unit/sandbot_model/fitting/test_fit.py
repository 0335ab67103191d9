import dataclasses
import pickle
from dataclasses import replace

import numpy as np
import pytest

from sandbot_common.errors import InputError
from sandbot_model.data.conditions import cells_of
from sandbot_model.fitting.errors import with_sampled_errors
from sandbot_model.fitting.fit import fit, fitted_at
from sandbot_model.fitting.text import UNDETERMINED, with_error
from sandbot_model.fitting.thresholds import LACK_OF_FIT
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.formula import formula_effect
from sandbot_model.physics.gait import clock
from sandbot_model.physics.model import model_of

EFFECTS = catalogue()
K = np.interp([0.58, 0.59325, 0.6065, 0.61975, 0.633], [0.58, 0.6, 0.633], [170.0, 205.0, 220.0])


def test_recovers_what_was_planted(drawn):
    found = fit(model_of("simple", (), EFFECTS), cells_of(drawn()))
    delta_t, v_swim = found.parameters["delta_t_s"], found.parameters["v_swim_m_s"]
    assert abs(delta_t.value - 0.4) < 4 * delta_t.stderr
    assert abs(v_swim.value - 0.02) < 4 * v_swim.stderr
    assert (np.abs(found.k_n_per_m - K) < 5 * found.k_stderr_n_per_m + 0.3).all()
    assert found.lack_of_fit_p > 1e-3
    assert not found.at_bounds
    assert not found.implausible


def test_what_nothing_measured_is_neither_implausible_nor_at_a_bound(smooth, drawn):
    """The search may leave it anywhere. Control: where some cells swim."""
    swims = fit(model_of("simple", (), EFFECTS), cells_of(drawn()))
    at = smooth.model.names.index("v_swim_m_s")
    for found, names in ((smooth, ()), (swims, ("v_swim_m_s",))):
        theta = found.point.theta.copy()
        theta[at] = found.model.parameters[at].search[1]
        moved = fitted_at(found.model, found.cells, dataclasses.replace(found.point, theta=theta))
        assert np.isnan(moved.parameters["v_swim_m_s"].stderr) == (not names)
        assert moved.at_bounds == moved.implausible == names


K_AND_A = ("x.a", "k at φ 0.580", "k at φ 0.606", "k at φ 0.633")


@pytest.mark.parametrize(
    ("formula", "omega", "together"),
    [
        ("k*a; a [1] in 0.5..2", (4, 8, 12, 16), K_AND_A),
        ("k*(1 + a*(phi - 0.57)); a [1] in -5..5", (4, 8, 12, 16), K_AND_A),
        ("k*(1 + a*(omega/12 - 1)); a [1] in -1..1", (4, 8, 12, 16), ()),
        ("k", (4,), ("delta_t_s", *K_AND_A[1:])),
        ("k", (3, 4), ()),
    ],
)
def test_what_is_known_only_together_is_not_determined(drawn, formula, omega, together):
    """k is free at every φ; at one ω, the ground's stiffness and its response time have the same effect."""
    names = () if formula == "k" else ("x",)
    effects = {**EFFECTS, **{name: formula_effect(f"{name}: strength: {formula}") for name in names}}
    found = with_sampled_errors(fit(model_of("simple", names, effects), cells_of(drawn(levels=3, omega=omega))))
    assert found.known_only_together == together
    told = {name: UNDETERMINED in text for name, text in found.estimates()}
    assert [name for name, hidden in told.items() if hidden and name != "v_swim_m_s"] == list(together)
    step = found.to_dict()
    assert step["known_only_together"] == list(together)
    assert (step["parameters"]["delta_t_s"]["stderr"] is None) == ("delta_t_s" in together)


def test_at_one_phi_a_response_that_depends_on_phi_is_known_only_with_the_response_time(drawn):
    trials = drawn(levels=2)
    cells = cells_of(trials.select(trials.phi > 0.6))
    found = fit(model_of("simple", ("phi_dependent_response",), EFFECTS), cells)
    assert found.known_only_together == ("delta_t_s", "phi_dependent_response.b")
    assert found.k_stderr_n_per_m[0] < 0.01 * found.k_n_per_m[0]


@pytest.mark.slow
def test_standard_errors_cover_the_truth(drawn):
    pulls = []
    for seed in range(10):
        found = fit(model_of("simple", (), EFFECTS), cells_of(drawn(seed=seed)))
        pulls.append((found.parameters["delta_t_s"].value - 0.4) / found.parameters["delta_t_s"].stderr)
    assert 0.4 < np.std(pulls) < 2.0


def test_speed_alone_is_enough(drawn):
    trials = drawn()
    nothing = np.full(len(trials), np.nan)
    trials = dataclasses.replace(trials, lift_m=nothing, peak_speed_m_s=nothing, first_step_m=nothing)
    found = fit(model_of("simple", (), EFFECTS), cells_of(trials))
    assert found.parameters["delta_t_s"].value == pytest.approx(0.4, abs=0.06)
    assert list(found.goodness.lack_of_fit) == ["speed"]


def test_without_replicates_nothing_is_tested(drawn):
    found = fit(model_of("simple", (), EFFECTS), cells_of(drawn(replicates=1)))
    assert np.isnan(found.lack_of_fit_p)
    assert found.rmse_m_s < 0.02


@pytest.mark.parametrize(("name", "least"), [("phi_nonuniformity", 0.01), ("stance_overlap", 0.0)])
def test_predicts_what_it_has_fitted(drawn, name, least):
    """Ground that differs along the track is averaged over; ``least`` is what the chain alone is off by somewhere."""
    cells = dataclasses.replace(cells_of(drawn(levels=4)), phi_scatter=0.0)
    base = fit(model_of("simple", (), EFFECTS), cells)
    model = model_of("simple", (name,), EFFECTS, held={f"{name}.{EFFECTS[name].parameters[0].name}": 0.004})
    found = fitted_at(model, cells, dataclasses.replace(base.point, theta=np.append(base.point.theta, 0.004)))
    phi = cells.level_phi[cells.level]
    said = found.predict(phi, cells.omega, cells.clock)
    off = np.abs(said.speed_m_s - found.predicted[:, 0])
    assert np.sqrt(np.mean(off**2)) < 2.5e-3
    np.testing.assert_allclose(said.lift_m, found.predicted[:, 1], atol=2e-4)
    inputs, params = model.inputs(found.point.theta, found.k_n_per_m[cells.level], cells.omega, phi, cells.clock)
    alone = model.walker.predict(inputs, params).speed_m_s
    assert np.abs(alone - said.speed_m_s).max() >= least


def test_predicts_for_the_gait_of_most_trials(two_gaits):
    """Control: another gait that is asked for."""
    assert (two_gaits.gait, two_gaits.cells.gait[0]) == ("SGCS", "HGCS")
    usual, soft, hard = (two_gaits.predict(0.633, 10.0, one).speed_m_s for one in (None, *clock(["SGCS", "HGCS"])))
    assert usual == soft
    assert abs(usual - hard) > 5e-3


@pytest.mark.parametrize(
    ("phi", "omega", "said"),
    [
        (np.nan, 10.0, "phi: nan is out of range; volume fractions between 0 and 1"),
        ([0.6, 62], 10.0, "phi: 62 is out of range"),
        (0.6, [10.0, -1.0], "omega: -1 is out of range; finite leg frequencies above 0 rad/s"),
        (0.6, 0.0, "omega: 0 is out of range"),
        (0.6, np.inf, "omega: inf is out of range"),
        (0.6, "fast", "omega: 'fast': not numbers; finite leg frequencies"),
        ([0.6, 0.61], [8.0, 9.0, 10.0], r"shapes \(2,\), \(3,\) can't be broadcast"),
    ],
)
def test_what_can_not_be_predicted_is_refused(two_gaits, phi, omega, said):
    for method in (two_gaits.predict, two_gaits.uncertainty):
        with pytest.raises(InputError, match=said):
            method(phi, omega)
    assert two_gaits.predict(0.7, [1e-3, 10.0]).speed_m_s.shape == (2,)


def test_predicts_between_cells(drawn):
    found = fit(model_of("simple", (), EFFECTS), cells_of(drawn()))
    seen = found.predict(np.array([0.59, 0.61])[:, None], np.array([6.0, 10.0, 14.0]))
    assert seen.speed_m_s.shape == (2, 3)
    assert np.isfinite(seen.speed_m_s).all()


@pytest.mark.parametrize(
    ("base", "names", "message"),
    [
        ("simpel", (), "not one of simple, full"),
        ("simple", ("overlap",), "not in the catalogue"),
        ("full", ("exact_leg_arc",), "part of the full model already"),
        ("simple", ("leg_slip", "leg_slip"), "named twice"),
    ],
)
def test_refuses_unknown_models(base, names, message):
    with pytest.raises(InputError, match=message):
        model_of(base, names, EFFECTS)


def test_cost_does_not_grow_with_trials(drawn):
    few, many = cells_of(drawn(replicates=2)), cells_of(drawn(replicates=20))
    assert few.mean.shape == many.mean.shape


@pytest.fixture(scope="module")
def slipping(drawn):
    return fit(model_of("simple", ("leg_slip",), EFFECTS), cells_of(drawn(("leg_slip",), levels=3)))


def test_it_prints_as_a_person_would_write_it(slipping):
    said = repr(slipping)
    assert len(said.splitlines()) <= 12
    assert said.startswith("simple model + leg_slip: fitted to 63 trials in 21 conditions\n")
    delta_t = slipping.parameters["delta_t_s"]
    assert f"delta_t_s                   {delta_t.value:.4f} ± {delta_t.stderr:.4f} s\n" in said
    assert f"{100 * slipping.rmse_m_s:.2f} cm/s in sample" in said


def test_a_long_name_does_not_run_into_its_value(slipping, monkeypatch):
    name = "disturbed_ground.k_l_n_per_m"
    monkeypatch.setattr(type(slipping), "estimates", lambda _: [(name, "185.0 ± 1.6 N/m")])
    _, first, second, _ = repr(slipping).splitlines()
    assert first == f"  {name}  185.0 ± 1.6 N/m"
    assert second.index("cm/s") > second.index(f"{100 * slipping.rmse_m_s:.2f}") == first.index("185")


@pytest.mark.parametrize(("p", "known"), [(0.9 * LACK_OF_FIT, 42), (np.nan, 0), (0.5, 5)])
def test_a_model_that_fails_or_cannot_be_tested_is_given_without_standard_errors(slipping, p, known):
    rejected = as_tested(slipping, p, known)
    value, stderr = slipping.parameters["delta_t_s"]
    assert f"delta_t_s                   {value:.3g} s\n" in repr(rejected)
    assert "±" not in repr(rejected)
    assert rejected.value_text(value, np.nan) == UNDETERMINED
    assert rejected.to_dict()["parameters"] == slipping.to_dict()["parameters"]
    # Controls: no lack of fit, and just enough replicates.
    for passing in (as_tested(slipping, 1.1 * LACK_OF_FIT, 42), as_tested(slipping, 0.5, 6)):
        assert passing.value_text(value, stderr) == with_error(value, stderr)


def test_beside_an_effect_that_the_end_of_its_search_stopped_nothing_has_a_standard_error(slipping):
    parameter = slipping.model.parameter("leg_slip.sigma")
    index = slipping.model.names.index("leg_slip.sigma")

    def with_slip(sigma):
        theta = slipping.point.theta.copy()
        theta[index] = sigma
        return replace(slipping, point=replace(slipping.point, theta=theta))

    stopped = with_slip(parameter.search[1])
    assert stopped.stopped == ("leg_slip.sigma",)
    assert "±" not in repr(stopped)
    assert stopped.to_dict()["parameters"]["delta_t_s"]["stderr"] > 0
    # Controls: beyond its plausible range, and where it vanishes.
    for held in (1.2 * parameter.high, parameter.neutral):
        assert with_slip(held).stopped == ()
        assert "±" in repr(with_slip(held))


def as_tested(fit, p, known):
    """A fit with this p of lack of fit and so many degrees of freedom of pure error."""
    cells = replace(fit.cells, pure_error_dof=np.full(4, known))
    return replace(fit, cells=cells, goodness=replace(fit.goodness, lack_of_fit_p=p))


def test_its_tables_hold_its_numbers(slipping):
    frame, residuals = slipping.to_frame(), slipping.residuals_frame()
    assert frame.loc["leg_slip.sigma", "value"] == slipping.parameters["leg_slip.sigma"].value
    assert frame.loc["k_n_per_m", "stderr"].to_numpy() == pytest.approx(slipping.k_stderr_n_per_m)
    assert len(residuals) == slipping.problem.measured.sum()
    assert sorted(set(residuals.level_phi)) == sorted(frame.loc["k_n_per_m", "phi"])
    missed = residuals[residuals.z.abs() > 3]
    assert len(missed) == len(slipping.fails)
    assert (residuals.measured - residuals.predicted).to_numpy() == pytest.approx(residuals.residual)


def test_a_pickle_holds_what_was_found_and_no_working(slipping):
    slipping.to_dict()
    packed = pickle.dumps(slipping)
    assert len(packed) < len(pickle.dumps(slipping.cells)) + 10_000
    again = pickle.loads(packed)
    assert "state" not in vars(again)
    assert again.to_dict() == slipping.to_dict()
