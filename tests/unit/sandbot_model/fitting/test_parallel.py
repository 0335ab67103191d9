"""Fits elsewhere: the same numbers in the same order, a user's effects included, and one line where nobody fits."""

import json
import os
import signal
import socket
from contextlib import contextmanager

import psutil
import pytest

from sandbot_common.cluster import connected
from sandbot_model.data.conditions import cells_of
from sandbot_model.discovery.discover import discover
from sandbot_model.fitting.bootstrap import bootstrap
from sandbot_model.fitting.parallel import users_modules
from sandbot_model.physics.catalogue import catalogue
from sandbot_model.physics.model import model_of
from sandbot_model.tools import compare as compare_tool
from sandbot_model.tools import discover as discover_tool
from sandbot_record.trials.csv_table import write_csv

OWN = """
from sandbot_model.physics.effect import Effect, Parameter

SCALE = 0.8


def kept(eta):
    return 1 - SCALE * eta


class Loss(Effect):
    identifier = "loss"
    stage = "speed"
    formula = "v -> v (1 - 0.8 eta)"
    source = "me"
    seen_in = "v"
    parameters = (Parameter("eta", "1", 0.0, 0.5, 0.1, "share lost"),)

    def apply(self, chain, p):
        chain.kept = chain.kept * kept(p["eta"])
"""
BRAKE = "brake: balance: extra_force = c*omega; c [N s] in 0..0.1"


@contextmanager
def cluster(address):
    """The ``map`` that fits are given."""
    with connected(address, by_value=users_modules()) as workers, workers.map() as fit_all:
        yield fit_all


@pytest.fixture
def nobody():
    """An address where nobody listens, kept from others."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        yield f"tcp://127.0.0.1:{taken.getsockname()[1]}"


@pytest.mark.whole  # a bootstrap on a cluster that loses a worker is below
@pytest.mark.slow
def test_discovery_with_a_users_effects_is_the_same_on_a_cluster(scheduler, drawn, tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(OWN)
    known = catalogue([path], [BRAKE])
    few = {name: known[name] for name in ("loss", "brake", "swimming_thrust")}
    cells = cells_of(drawn(("stance_overlap",), seed=6))
    heard = []
    here = discover(cells, few, max_effects=2)
    with cluster(scheduler) as fit_all:
        there = discover(cells, few, max_effects=2, fit_all=fit_all, progress=lambda *said: heard.append(said))
    assert here.verdict.effects == ("loss",)
    assert there.verdict == here.verdict
    assert {one.effects for one in there.fits} == {one.effects for one in here.fits}
    for one, other in zip(there.fits, here.fits, strict=True):
        assert one.bic == pytest.approx(other.bic, rel=1e-9)
    assert ("singles", 1, 3) in heard
    assert ("singles", 3, 3) in heard


@contextmanager
def doomed():
    """A ``map`` over two workers, one of which is killed once, after the first result of several; who was killed."""
    from distributed import LocalCluster

    killed = []

    def with_a_death(function, tasks):
        """The first result, then the death of a worker, then all others."""
        found = iter(fit_all(function, tasks))
        if killed or len(tasks) < 2:
            return found
        first = next(found)
        killed.append(next(one.process.pid for one in local.workers.values()))
        os.kill(killed[0], signal.SIGKILL)
        return [first, *found]

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", host="127.0.0.1") as local,
        cluster(local.scheduler_address) as fit_all,
    ):
        yield with_a_death, killed
        assert len(killed) == 1
        assert not psutil.pid_exists(killed[0])


@pytest.mark.slow
def test_a_worker_killed_midway_changes_no_byte(drawn):
    trials, model = drawn(seed=3, levels=2), model_of("simple", (), catalogue())
    with doomed() as (fit_all, killed):
        harmed = bootstrap(trials, model, 6, fit_all=fit_all)
        assert killed
        unharmed = bootstrap(trials, model, 6, fit_all=fit_all)
    assert json.dumps(harmed) == json.dumps(unharmed) == json.dumps(bootstrap(trials, model, 6))


@pytest.mark.slow
@pytest.mark.whole
def test_a_worker_killed_midway_changes_no_byte_of_a_discovery(drawn):
    cells = cells_of(drawn(("stance_overlap",), seed=6))
    few = {name: effect for name, effect in catalogue().items() if name in ("stance_overlap", "leg_slip", "cohesion")}
    with doomed() as (fit_all, killed):
        harmed = discover(cells, few, max_effects=2, fit_all=fit_all)
        assert killed
    here = discover(cells, few, max_effects=2)
    assert here.verdict.effects == ("stance_overlap",)
    assert json.dumps(harmed.to_dict()) == json.dumps(here.to_dict())


@pytest.mark.parametrize("tool", [discover_tool, compare_tool])
def test_an_address_where_nobody_listens_is_one_line_and_exit_2(tool, nobody, drawn, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(connected.__wrapped__, "__defaults__", (0.3,))
    write_csv(drawn(levels=2), tmp_path / "t.csv")
    more = ["--bootstrap", "2"] if tool is compare_tool else []
    out = tmp_path / "found.json"
    assert tool.main([str(tmp_path / "t.csv"), "--dask", nobody, "--json", str(out), *more]) == 2
    said = capsys.readouterr().err.strip()
    assert f"--dask '{nobody}': no Dask scheduler there (no answer within 0.3 s)" in said
    assert "\n" not in said
    assert not out.exists()


def test_compare_has_work_for_a_cluster_only_with_a_bootstrap(drawn, tmp_path, capsys):
    write_csv(drawn(levels=2), tmp_path / "t.csv")
    assert compare_tool.main([str(tmp_path / "t.csv"), "--dask", "tcp://127.0.0.1:1"]) == 2
    assert "--bootstrap" in capsys.readouterr().err
