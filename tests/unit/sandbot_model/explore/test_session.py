"""Fits behind the page: those of ``compare``, each made once, none waited for without end."""

from concurrent.futures import BrokenExecutor, Executor, Future

import numpy as np
import pytest
from inline import Inline
from made_up import EFFECTS, made_up_trials

from sandbot_common.errors import InputError
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.compare import compare
from sandbot_model.discovery.criteria import of_bed
from sandbot_model.discovery.selection import Selection
from sandbot_model.explore import views
from sandbot_model.explore.session import Session
from sandbot_model.fitting.global_minimum import solve
from sandbot_model.report.theme import LIGHT


class Never(Executor):
    """Workers that are always busy: nothing submitted ever begins."""

    def submit(self, function, /, *arguments, **named):
        return Future()


def test_the_ladder_is_that_of_compare(session):
    selection = Selection(effects=("leg_slip", "stance_overlap"))
    ours = [step.fit for step in session.ladder(selection)]
    theirs = compare(session.cells, EFFECTS, selection.effects)
    for one, other in zip(ours, theirs, strict=True):
        assert one.effects == other.effects
        assert one.rmse_m_s == pytest.approx(other.rmse_m_s, rel=1e-3)
        assert one.deviance == pytest.approx(other.deviance, abs=0.05)


def test_the_page_has_the_uncertainty_of_compare_once_a_worker_has_sampled_it():
    """The threshold is sampled: until then the page has what derivatives give, which know nothing of it."""
    trials = made_up_trials(effect=("disturbed_ground", {"k_l_n_per_m": 172.0, "s_c": 0.95}))
    session, chosen = Session(cells_of(trials), Inline()), Selection(effects=("disturbed_ground",))
    before = session.step(chosen)
    assert before.fit.sample is None
    session.with_final_errors(chosen)
    after = session.step(chosen)
    assert after is session.step(chosen)
    assert session.with_final_errors(chosen) is after.fit
    assert after.fit.sample is not None
    theirs = compare(session.cells, EFFECTS, chosen.effects).fit
    phi, omega = theirs.level_phi[:, None], np.array([5.0, 9.0])
    np.testing.assert_allclose(after.fit.uncertainty(phi, omega), theirs.uncertainty(phi, omega), rtol=0.3, atol=3e-4)
    np.testing.assert_array_equal(after.speed_m_s, before.speed_m_s)


def test_a_set_fitted_once_is_not_fitted_again(session, monkeypatch):
    selection = Selection(effects=("leg_slip",))
    first = session.ladder(selection)
    monkeypatch.setattr("sandbot_model.explore.session.fit", None)
    assert session.ladder(selection) == first


class Busy(Executor):
    """Workers that say they are at it and never come to an end."""

    def submit(self, function, /, *arguments, **named):
        future = Future()
        future.set_running_or_notify_cancel()
        return future


def test_a_worker_that_does_not_come_to_an_end_is_not_waited_for(trials):
    session = Session(cells_of(trials), Busy())
    assert session.ladder(Selection(effects=("leg_slip",)))[-1].fit.effects == ("leg_slip",)


def test_what_no_worker_has_begun_is_fitted_here(trials):
    session = Session(cells_of(trials), Never())
    session.fit_ahead(Selection())
    assert set(session.previews(Selection()).values()) == {None}
    assert session.ladder(Selection(effects=("leg_slip",)))[-1].fit.effects == ("leg_slip",)
    assert session.previews(Selection())["leg_slip"] is not None


class Killed(Inline):
    """Workers the first of which are killed, with what they had in hand."""

    def __init__(self, error):
        self.error, self.killed, self.asked = error, True, 0

    def submit(self, function, /, *arguments, **named):
        self.asked += 1
        if not self.killed:
            return super().submit(function, *arguments, **named)
        future = Future()
        future.set_running_or_notify_cancel()
        future.set_exception(self.error)
        return future


def test_what_a_killed_worker_had_in_hand_is_asked_for_again(trials):
    chosen = Selection(effects=("leg_slip",))
    session = Session(cells_of(trials), workers := Killed(BrokenExecutor()))
    assert session.step(chosen).fit.effects == ("leg_slip",)
    session.fit_ahead(Selection())
    assert session.previews(Selection())["cable_drag"] is None
    assert session.with_final_errors(chosen) is None
    with pytest.raises(InputError, match="killed"):
        session.suggest(Selection(), lambda *_: None)
    workers.killed = False
    session.catalogue = lambda formulas=(): {name: EFFECTS[name] for name in ("leg_slip", "cable_drag")}
    session.fit_ahead(Selection())
    assert np.isfinite(session.previews(Selection())["cable_drag"]).all()
    assert session.with_final_errors(chosen) is not None


def test_a_fit_that_failed_is_not_asked_for_again(trials):
    session = Session(cells_of(trials), workers := Killed(ArithmeticError()))
    session.fit_ahead(Selection())
    asked = workers.asked
    workers.killed = False
    session.fit_ahead(Selection())
    assert np.isnan(session.previews(Selection())["cable_drag"]).all()
    assert workers.asked == asked


def test_promises_are_the_errors_that_come_true(trials):
    small = Session(cells_of(trials), Inline())
    small.catalogue = lambda formulas=(): {name: EFFECTS[name] for name in ("leg_slip", "cable_drag")}
    start = Selection(effects=("leg_slip",))
    small.ladder(start)
    small.fit_ahead(start)
    previews = small.previews(start)
    assert set(previews) == {"leg_slip", "cable_drag"}
    on = small.ladder(start.toggled(["leg_slip", "cable_drag"]))[-1].fit
    off = small.ladder(Selection())[-1].fit
    assert previews["cable_drag"] == pytest.approx((on.rmse_m_s, on.bic), rel=1e-6)
    assert previews["leg_slip"] == pytest.approx((off.rmse_m_s, off.bic), rel=1e-6)


@pytest.mark.parametrize(
    "selection",
    [Selection(effects=("levitation",)), Selection().held("mass", 1.0), Selection(formulas=("nonsense",))],
    ids=["effect", "parameter", "formula"],
)
def test_what_is_not_known_is_refused(session, selection):
    with pytest.raises(InputError):
        views.show(session, selection, LIGHT)


class Counting(Inline):
    """Counts what it is asked for."""

    def __init__(self):
        self.asked = []

    def submit(self, function, /, *arguments, **named):
        self.asked.append(function.__name__)
        return super().submit(function, *arguments, **named)


def test_a_suggestion_does_not_fit_again_what_the_page_has_fitted():
    """And says the same as discovery by itself, which leaves what is far off unrefined."""
    trials = made_up_trials(effect=("disturbed_ground", {"k_l_n_per_m": 172.0, "s_c": 0.95}))
    few = {name: EFFECTS[name] for name in ("disturbed_ground", "leg_slip", "cable_drag", "stance_overlap")}
    told, asked = {}, {}
    for ahead in (False, True):
        workers = Counting()
        session = Session(cells_of(trials), workers)
        session.catalogue = lambda formulas=(): few
        if ahead:
            session.step(Selection())
            session.fit_ahead(Selection())
        workers.asked.clear()
        told[ahead] = session.suggest(Selection(), lambda *_: None).to_dict()
        asked[ahead] = workers.asked
    for what in ("steps", "next_trials", "limits"):
        assert told[True][what] == told[False][what]
    for what in ("status", "effects", "alternatives"):
        assert told[True]["verdict"][what] == told[False]["verdict"][what]
    gains = {ahead: {one["effect"]: one["delta_chi2"] for one in told[ahead]["candidates"]} for ahead in told}
    assert all(gains[True][name] <= gains[False][name] + 0.1 for name in few)
    assert asked[False].count("solve") == 1
    assert asked[False].count("solve_first") >= len(few)
    # What the page shows has been searched beside; what lies beyond what is found has not.
    assert not {"solve", "solve_first", "solve_further", "solve_jumping"} & set(asked[True])


def test_a_suggestion_fits_anew_what_the_page_has_fitted_to_more_cells(trials, monkeypatch):
    """Discovery leaves out trials that went wrong and begins again."""
    session = Session(cells_of(trials), workers := Counting())
    session.step(Selection())
    workers.asked.clear()
    model, fewer = session.model(Selection()), session.cells.without(0)

    def discover(cells, *_, fit_all, **__):
        return list(fit_all(solve, [(model, cells, None), (model, fewer, None)]))

    monkeypatch.setattr("sandbot_model.explore.session.discover", discover)
    known, anew = session.suggest(Selection(), lambda *_: None)
    assert known is session.step(Selection()).fit.point
    assert anew.theta != pytest.approx(known.theta, rel=1e-6)
    assert workers.asked == ["solve"]


def test_a_suggestion_obeys_what_is_known_of_the_bed(trials, monkeypatch):
    asked = []
    monkeypatch.setattr(
        "sandbot_model.explore.session.discover", lambda *_, criteria, **__: asked.append(criteria.bed_scatter)
    )
    Session(cells_of(trials), Inline(), criteria=of_bed(0.003, None)).suggest(Selection(), lambda *_: None)
    assert asked == [0.003]
