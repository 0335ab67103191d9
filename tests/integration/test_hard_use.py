"""Names that few files have, folders that take nothing, and two campaigns at once into one folder."""

import subprocess
import sys

import bags
import pytest

from sandbot_bringup.tools import campaign
from sandbot_model.tools import effects
from sandbot_record.tools import table
from sandbot_record.trials import cache
from sandbot_record.trials.read import read

NAMES = ("a b", "φ ü 😀", "'\"`$(x)", "a;b&c|d", "%s{0}", "x" * 120, "end\nof line", ".hidden")
PLAN = "name: two\ngait: UNIFORM\nphi: [0.62]\nomega_rad_s: [{omega}]\nreplicates: {count}\nimages: none\n"


@pytest.mark.parametrize("name", NAMES)
def test_files_of_any_name_are_read_and_named_in_one_line(name, tmp_path, capsys):
    bags.trial_bag(tmp_path / name / "trials" / "t1")
    assert table.main([str(tmp_path / name)]) == 0
    assert len(read(tmp_path / name)) == 1
    bad = tmp_path / name / "bad.csv"
    bad.write_text("phi,omega_rad_s,speed_m_s\n0.6,fast,0.1\n")
    assert table.main([str(bad), "--out", str(tmp_path / name / "out.csv")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert " ".join(str(bad).splitlines()) in said
    assert "row 2, column omega_rad_s" in said


def test_a_folder_that_takes_nothing_is_one_line(tmp_path, capsys):
    # /proc refuses root, too.
    (tmp_path / "t.csv").write_text("phi,omega_rad_s,speed_m_s\n0.6,8,0.1\n")
    (tmp_path / "plan.yaml").write_text(PLAN.format(omega=16, count=1))
    for tool, words in (
        (table, [str(tmp_path / "t.csv"), "--out", "/proc/none/t.csv"]),
        (effects, ["--json", "/proc/none.json"]),
        (campaign, [str(tmp_path / "plan.yaml"), "--out", "/proc/none", "--batch"]),
    ):
        assert tool.main(words) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_a_campaign_that_takes_nothing_is_read_all_the_same(tmp_path, monkeypatch):
    bags.trial_bag(tmp_path / "c" / "trials" / "t1")

    def refused(*_):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(cache.files, "write_text", refused)
    assert len(read(tmp_path / "c")) == 1
    assert not (tmp_path / "c" / cache.CACHE).exists()


@pytest.mark.slow
@pytest.mark.parametrize("omega", [16, pytest.param(20, marks=pytest.mark.whole)])
def test_two_campaigns_at_once_into_one_folder(omega, tmp_path):
    main = "import sys; from sandbot_bringup.tools.campaign import main; sys.exit(main(sys.argv[1:]))"
    (tmp_path / "one.yaml").write_text(PLAN.format(omega=16, count=2))
    (tmp_path / "other.yaml").write_text(PLAN.format(omega=omega, count=2))
    both = [
        subprocess.Popen(
            [
                sys.executable,
                "-c",
                main,
                str(tmp_path / name),
                "--out",
                str(tmp_path / "c"),
                "--batch",
                "--workers",
                "1",
            ],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        for name in ("one.yaml", "other.yaml")
    ]
    said = [one.communicate(timeout=250)[1] for one in both]
    assert not [text for text in said if "Traceback" in text], said
    # The other comes too early, or when all is done.
    assert sorted(one.returncode for one in both) in ([0, 0], [0, 2])
    trials = read(tmp_path / "c")
    assert (len(trials), len(set(trials.omega_rad_s))) == (2, 1)
