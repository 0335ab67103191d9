"""A batch campaign and its table on a Dask cluster: the bytes of one machine though a worker dies, no trial lost."""

import os
import shutil
import signal
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

from sandbot_bringup.tools import campaign
from sandbot_record.tools import table
from sandbot_record.trials.from_bags import CACHE, TRIALS_CSV

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

PLAN = """
name: shared
seed: 4
gait: UNIFORM
images: none
phi: [0.6, 0.633]
omega_rad_s: [8.0, 20.0]
replicates: 2
periods: 4.0
"""


@pytest.fixture
def cluster():
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", host="127.0.0.1") as local:
        yield local


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    plan = tmp_path_factory.mktemp("plan") / "plan.yaml"
    plan.write_text(PLAN)

    def command(out, *options):
        return campaign.main([str(plan), "--out", str(out), "--batch", *options])

    return command


@pytest.fixture(scope="module")
def here(run, tmp_path_factory):
    """The campaign by this machine alone."""
    out = tmp_path_factory.mktemp("here") / "here"
    assert run(out) == 0
    return out


@contextmanager
def when_a_trial_is_there(folder, act):
    """Act once, in another thread, as soon as the folder has the bag of a trial."""
    ended, acted = threading.Event(), []

    def watch():
        while not ended.wait(0.02):
            if any(folder.glob("trials/*/metadata.yaml")):
                acted.append(act())
                return

    thread = threading.Thread(target=watch)
    thread.start()
    yield acted
    ended.set()
    thread.join()


def finished(folder):
    return sorted(path.parent.name for path in folder.glob("trials/*/metadata.yaml"))


@pytest.mark.whole  # test_parallel kills one of this host
def test_a_worker_killed_midway_changes_no_byte_of_a_campaign_or_its_table(cluster, run, here, tmp_path):
    address, there, rows = cluster.scheduler_address, tmp_path / "there", (here / "trials.csv").read_bytes()

    def kill():
        os.kill(next(one.process.pid for one in cluster.workers.values()), signal.SIGKILL)

    with when_a_trial_is_there(there, kill) as killed:
        assert run(there, "--dask", address) == 0
    assert killed
    assert (there / "trials.csv").read_bytes() == rows
    assert rows.count(b"\n") == 1 + 8

    for kept in (CACHE, TRIALS_CSV):
        (there / kept).unlink()
    assert table.main([str(there), "--dask", address]) == 0
    assert (there / "trials.csv").read_bytes() == rows


@pytest.mark.whole  # a worker that is lost is above
def test_a_cluster_that_is_lost_loses_no_finished_trial(cluster, run, here, tmp_path, capsys):
    lost = tmp_path / "lost"
    with when_a_trial_is_there(lost, cluster.close) as closed:
        assert run(lost, "--dask", cluster.scheduler_address) == 1
    assert closed
    done = finished(lost)
    assert 1 <= len(done) < 8
    assert "failed: the cluster was lost; resume to run it" in capsys.readouterr().out
    assert run(lost) == 0
    assert (lost / "trials.csv").read_bytes() == (here / "trials.csv").read_bytes()


def test_nobody_at_the_address_leaves_nothing_behind(run, tmp_path, capsys):
    assert run(tmp_path / "out", "--dask", "nowhere") == 2
    assert "no Dask scheduler there" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.whole  # test_parallel has another
def test_where_nothing_runs_in_parallel_workers_are_refused(here, tmp_path, capsys):
    rows = Path(shutil.copy(here / "trials.csv", tmp_path))
    for option in (["--workers", "2"], ["--dask", "anywhere"]):
        assert table.main([str(rows), *option]) == 2
        assert f"{option[0]}: only the bags of one folder are shared out" in capsys.readouterr().err
    assert campaign.main([str(here / "campaign.yaml"), "--dask", "anywhere"]) == 2
    assert "--dask: live trials run one by one" in capsys.readouterr().err
