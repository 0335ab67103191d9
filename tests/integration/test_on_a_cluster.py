"""A batch campaign and its table on a Dask cluster: the bytes of one machine though a worker dies, no trial lost."""

import os
import shutil
import signal
import threading
from contextlib import contextmanager

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


@pytest.fixture
def run(tmp_path):
    (tmp_path / "plan.yaml").write_text(PLAN)

    def command(name, *options):
        return campaign.main([str(tmp_path / "plan.yaml"), "--out", str(tmp_path / name), "--batch", *options])

    return command


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


def test_a_worker_killed_midway_changes_no_byte_of_a_campaign_or_its_table(cluster, run, tmp_path):
    address = cluster.scheduler_address

    def kill():
        os.kill(next(one.process.pid for one in cluster.workers.values()), signal.SIGKILL)

    with when_a_trial_is_there(tmp_path / "there", kill) as killed:
        assert run("there", "--dask", address) == 0
    assert killed
    assert run("here") == 0
    here = (tmp_path / "here" / "trials.csv").read_bytes()
    assert (tmp_path / "there" / "trials.csv").read_bytes() == here
    assert here.count(b"\n") == 1 + 8

    for kept in (CACHE, TRIALS_CSV):
        (tmp_path / "there" / kept).unlink()
    assert table.main([str(tmp_path / "there"), "--dask", address]) == 0
    assert (tmp_path / "there" / "trials.csv").read_bytes() == here


def test_a_cluster_that_is_lost_loses_no_finished_trial(cluster, run, tmp_path, capsys):
    with when_a_trial_is_there(tmp_path / "lost", cluster.close) as closed:
        assert run("lost", "--dask", cluster.scheduler_address) == 1
    assert closed
    done = finished(tmp_path / "lost")
    assert 1 <= len(done) < 8
    assert "failed: the cluster was lost; resume to run it" in capsys.readouterr().out
    assert run("lost") == 0
    assert run("here") == 0
    assert (tmp_path / "lost" / "trials.csv").read_bytes() == (tmp_path / "here" / "trials.csv").read_bytes()


def test_nobody_at_the_address_leaves_nothing_behind(run, tmp_path, capsys):
    assert run("out", "--dask", "nowhere") == 2
    assert "no Dask scheduler there" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_where_a_crew_has_no_work_it_is_refused(cluster, run, tmp_path, capsys):
    assert run("here") == 0
    for crew in (["--workers", "2"], ["--dask", cluster.scheduler_address]):
        assert table.main([str(tmp_path / "here" / "trials.csv"), *crew]) == 2
        assert f"{crew[0]}: only the bags of one folder are shared out" in capsys.readouterr().err
    shutil.rmtree(tmp_path / "here" / "trials")
    assert campaign.main([str(tmp_path / "plan.yaml"), "--dask", cluster.scheduler_address]) == 2
    assert "--dask: live trials run one by one" in capsys.readouterr().err
