"""The loop closes: too little is known, the verdict says what to measure, the lab measures it, one effect is left."""

import json

import pytest

from sandbot_bringup.config import config_folder
from sandbot_bringup.tools import campaign
from sandbot_model.tools import discover
from sandbot_record.trials.csv_table import read_csv

# In make test the loop is closed by test_until_verdict, and --plan by test_campaign_batch.
pytestmark = [pytest.mark.slow, pytest.mark.whole, pytest.mark.timeout(400)]

ROUNDS = 3
"""How often the lab may be asked."""


def run(plan, out, *more):
    world = config_folder() / "pilot_world.yaml"
    assert campaign.main([str(config_folder() / plan), "--out", str(out), "--batch", "--world", str(world), *more]) == 0


def verdict_on(path, *data):
    assert discover.main([*map(str, data), "--max-effects", "1", "--json", str(path)]) == 0
    return json.loads(path.read_text())


def test_an_ambiguous_verdict_asks_for_the_trials_that_settle_it(tmp_path):
    run("pilot.yaml", tmp_path / "pilot")
    notebook = tmp_path / "notebook.csv"
    rows = (tmp_path / "pilot" / "trials.csv").read_text().splitlines()
    notebook.write_text("\n".join(",".join(row.split(",")[1:7]) for row in rows) + "\n")
    assert set(notebook.read_text().splitlines()[0].split(",")) >= {"phi", "omega_rad_s", "speed_m_s"}

    found = verdict_on(tmp_path / "0.json", notebook)
    assert found["data"]["observables"] == ["speed"]
    assert found["verdict"]["status"] == "ambiguous"
    assert ["disturbed_ground"] in found["verdict"]["alternatives"]
    assert len(found["next_trials"]) >= 3

    data = [notebook]
    for number in range(ROUNDS):
        out = tmp_path / f"next{number}"
        before = found["next_trials"]
        run("pilot_next.yaml", out, "--plan", str(tmp_path / f"{number}.json"))
        asked = {round(one["omega_rad_s"], 2) for one in before if one["omega_rad_s"] is not None}
        assert asked <= set(read_csv(out / "trials.csv").omega_rad_s.round(2))
        data.append(out)
        found = verdict_on(tmp_path / f"{number + 1}.json", *data)
        if found["verdict"]["status"] != "ambiguous":
            break
    assert (found["verdict"]["status"], found["verdict"]["effects"]) == ("identified", ["disturbed_ground"])
    assert found["steps"][-1]["cv_rmse_m_s"] < 0.5 * found["steps"][0]["cv_rmse_m_s"]
