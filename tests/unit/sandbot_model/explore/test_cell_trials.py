"""What stands behind a cell: its trials, their waveforms and their bags."""

import shutil

import pytest
from made_up import walking_bag

from sandbot_model.discovery.selection import Selection
from sandbot_model.explore import cell_trials
from sandbot_model.explore.app import Explorer
from sandbot_model.report import waveforms, write_comparison
from sandbot_model.report.provenance import bags_of
from sandbot_model.report.theme import LIGHT


def test_a_cell_shows_its_trials_waveforms_and_recordings(session, trials, tmp_path):
    cell = 5
    name = str(trials.trial_id[waveforms.trials_of(trials, session.cells, cell)[0]])
    bag = walking_bag(tmp_path / name, v_x=lambda t: 0.1)
    explorer = Explorer(session, trials, [bag], "test")
    shown = str(cell_trials.parts(trials, explorer.bags, session.step(Selection()).fit, cell, LIGHT))
    assert "waveforms" in shown
    assert "No video: the camera frames of these trials were not kept." in shown
    assert "no bag of that name" in shown
    client = explorer.app().server.test_client()
    answer = client.get(f"/bag/{name}/{name}_0.mcap", headers={"Host": "127.0.0.1:1"})
    assert answer.data == (bag / f"{name}_0.mcap").read_bytes()
    for other in (f"/bag/{name}/metadata.yaml", "/bag/absent/absent_0.mcap"):
        assert client.get(other, headers={"Host": "127.0.0.1:1"}).status_code == 404
    (tmp_path / "other.mcap").write_bytes(b"not shown")
    assert b"not shown" not in client.get(f"/bag/{name}/..%2Fother.mcap", headers={"Host": "127.0.0.1:1"}).data


def test_the_film_of_a_trial_run_again_is_that_of_the_new_bag(tmp_path, monkeypatch):
    read = []
    monkeypatch.setattr(cell_trials.film_strip, "of_bag", lambda bag: read.append(bag) or [(b"", "a frame")])
    bag = walking_bag(tmp_path / "t", v_x=lambda t: 0.1)
    cell_trials.film({"t": bag}, ["t"])
    cell_trials.film({"t": bag}, ["t"])
    assert len(read) == 1
    shutil.rmtree(bag)
    walking_bag(bag, v_x=lambda t: 0.2)
    cell_trials.film({"t": bag}, ["t"])
    assert len(read) == 2


@pytest.mark.slow
def test_a_torn_bag_is_said_on_the_page(session, trials, tmp_path):
    bag = walking_bag(tmp_path / "torn", v_x=lambda t: 0.1)
    recording = bag / "torn_0.mcap"
    recording.write_bytes(recording.read_bytes()[:-200])
    explorer = Explorer(session, trials, [bag], "test")
    ((name, why),) = explorer.provenance.excluded
    assert name == "torn"
    assert "recover" in why
    assert "1 trials excluded, and why" in str(explorer.app().layout)
    fits = [session.step(Selection()).fit]
    write_comparison(tmp_path / "report.html", fits, trials, title="torn", data=[bag])
    assert "1 excluded" in (tmp_path / "report.html").read_text(encoding="utf-8")
    found, (line,) = waveforms.read(explorer.bags, ["torn"])
    assert found == []
    assert "recover" in line


def test_bags_are_known_by_their_whole_name(tmp_path):
    bag = tmp_path / "trials" / "phi0.6000_w04.000_r01"
    bag.mkdir(parents=True)
    (bag / "metadata.yaml").touch()
    assert bags_of([tmp_path]) == {"phi0.6000_w04.000_r01": bag}
