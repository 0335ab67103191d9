"""Bad input to any command: exit code 2, one line that says what is wrong and where, and nothing written."""

import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from sandbot_bringup.tools import campaign, unseal
from sandbot_hardware import simulate_command as simulate
from sandbot_lab.tools import penetrometer
from sandbot_model.tools import atlas, compare, discover, effects, export
from sandbot_record.bags.writer import BagWriter
from sandbot_record.tools import info, record, recover, table
from sandbot_tracking.tools import calibrate, track_video

PLAN = "name: small\ngait: UNIFORM\nphi: [0.6, 0.633]\nomega_rad_s: [8, 20]\nreplicates: 1\n"

BATCH = "--out @/out --batch"
UNTIL = f"{BATCH} --until verdict"

HEADER = "phi,omega_rad_s,speed_m_s\n"
GOOD = HEADER + "0.633,16,0.203\n0.633,16,0.198\n"

CAMERAS = """dorsal: {width: 640, height: 480, fx: 900.0, fy: 900.0, cx: 319.5, cy: 239.5,
  distortion: [0.0, 0.0, 0.0, 0.0, 0.0], position_m: [0.3, 0.0, 1.5],
  rotation: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]], plane: {normal: z, offset_m: 0.05}}
"""

NO_FOCUS = CAMERAS.replace("fx: 900.0", "fx: .nan")

POINTS = "u_px,v_px,x_m,y_m,z_m\n" + "".join(f"{10 * n},{20 * n},0.{n},0.1,0.2\n" for n in range(1, 8))

DISCOVERY = json.dumps(
    {
        "schema": "sandbot.discovery/1",
        "verdict": {"status": "adequate", "effects": [], "because": "no reason"},
        "steps": [{"effects": [], "cv_rmse_m_s": 0.01}],
        "noise_floor_m_s": 0.01,
    }
)


def empty_bag(path: Path) -> None:
    BagWriter(path).close()


def small_bag(path: Path) -> None:
    with BagWriter(path) as writer:
        writer.add_topic("/note", "std_msgs/msg/Empty")
        writer.write("/note", b"\x00\x01\x00\x00\x00", 10**9)


@dataclass(frozen=True)
class Case:
    """A command line in a folder with ``files``; the one line on stderr must contain all ``words``."""

    name: str
    tool: ModuleType
    line: str
    words: tuple[str, ...]
    files: dict[str, str | bytes | Callable[[Path], None]]

    def argv(self, folder: Path) -> list[str]:
        """The arguments; ``@`` stands for the folder, ``_~_`` for a space within one argument."""
        return [word.replace("@", str(folder)).replace("_~_", " ") for word in self.line.split()]


def case(name, tool, line, *words, **files):
    return Case(name, tool, line, words, {key.replace("__", "."): content for key, content in files.items()})


def campaign_case(name, line, *words, change="", **files):
    """Of PLAN with a line more."""
    return case(name, campaign, f"@/plan.yaml {line}", *words, plan__yaml=PLAN + change, **files)


def plan_case(name, change, *words):
    return campaign_case(f"plan-{name}", BATCH, "plan.yaml", *words, change=change)


def csv_case(name, text, *words, tool=compare):
    return case(f"csv-{name}", tool, "@/trials.csv --json @/out.json", "trials.csv", *words, trials__csv=text)


def world_case(name, text, *words):
    line = f"{BATCH} --world @/world.yaml"
    return campaign_case(f"world-{name}", line, "world.yaml", *words, world__yaml=text)


def formula_case(name, formula, *words):
    line = f"--json @/out.json --effect {formula.replace(' ', '_~_')}"
    return case(f"formula-{name}", effects, line, "effect", *words)


def effects_file_case(name, text, *words):
    line = "--json @/out.json --effects-from @/mine.py"
    return case(f"effects-file-{name}", effects, line, "mine.py", *words, mine__py=text)


OTHER_ROBOT, NO_ANGLE = "robot: mine.yaml\n", "leg_mount_rad: east\n"

PLANS = [
    plan_case("unknown-key", "phy: [0.6]\n", "phy", "phi"),
    plan_case("nan", "periods: .nan\n", "periods", "nan"),
    plan_case("infinite", "min_duration_s: .inf\n", "min_duration_s", "inf"),
    plan_case("out-of-range", "standing_s: -1\n", "standing_s", "-1"),
    plan_case("text-for-a-number", "seed: many\n", "seed", "many"),
    plan_case("unknown-gait", "gait_parameters: {duty: 0.5}\n", "gait_parameters", "UNIFORM"),
    plan_case("extra-trial-out-of-range", "extra_trials: [{phi: 0.9, omega_rad_s: 8}]\n", "extra_trials[0]", "0.9"),
    plan_case("not-yaml", "phi: [0.6\n"),
    # What is wrong in a file that the plan names is told by that file's name.
    campaign_case("leg-mount-no-angle", BATCH, "mine.yaml", "'east'", change=OTHER_ROBOT, mine__yaml=NO_ANGLE),
    campaign_case("no-such-cameras", BATCH, "@/mine.yaml", "no such file", change="cameras: mine.yaml\n"),
    plan_case("unknown-bed-key", "bed: {puls: 3}\n", "bed: unknown key", "puls"),
    case("plan-missing", campaign, "@/nowhere.yaml --out @/out --batch", "nowhere.yaml", "no such file"),
    case("plan-like-no-other", campaign, "nosuch.yaml", "nosuch.yaml: no such file; known: demo.yaml, "),
    case("plan-where-a-file-is", campaign, "@/p.yaml --out @/p.yaml --batch", "p.yaml: is a file", p__yaml=PLAN),
    campaign_case(
        "next-trials-of-no-discovery",
        f"{BATCH} --plan @/plan.yaml",
        "plan.yaml: not JSON: line 1",
        "the file that discover --json writes",
    ),
    campaign_case("until-alpha", f"{UNTIL} --alpha 2", "--alpha: 2.0 is outside [1e-06, 0.5]"),
    campaign_case("until-alpha-alone", f"{BATCH} --alpha 0.1", "error: --alpha needs --until verdict"),
    campaign_case("until-model", f"{UNTIL} --model foo", "error: --model: 'foo' is not a base model; known: simple"),
    campaign_case("until-budget", f"{UNTIL} --budget 1", "error: --budget: 1 trials are fewer than the"),
    campaign_case("until-sentinel", UNTIL, "@/plan.yaml: sentinel: 2 with until", change="sentinel: 2\n"),
    plan_case("until-alpha", "until: verdict\nalpha: 2\n", "alpha: 2 is outside"),
    plan_case("until-model", "until: verdict\nmodel: foo\n", "model: 'foo' is not"),
    case("plan-not-given", campaign, "--batch", "plan"),
    case("plan-of-a-folder-without-one", campaign, "@ --batch", "campaign.yaml", "no such file"),
    case("plan-empty", campaign, "@/plan.yaml --out @/out --batch", "plan.yaml", plan__yaml=""),
    campaign_case("no-workers", f"{BATCH} --workers 0", "--workers", "0"),
    campaign_case("silence-below-0", "--out @/out --dry-run --silence -1", "--silence", "0.3 to 10"),
    campaign_case("silence-in-batch", f"{BATCH} --silence 2", "--silence", "--batch"),
    campaign_case("workers-of-live-trials", "--out @/out --workers 2", "--workers", "--batch"),
    case("title-of-no-report", compare, "@/t.csv --title x", "--title", "--html", t__csv=GOOD),
    case("title-of-no-report-of-a-discovery", discover, "@/t.csv --title x", "--title", "--html", t__csv=GOOD),
    case("codec-of-no-video", record, "/x --out @/b --images jpeg --video-codec ffv1", "--video-codec", "jpeg"),
    campaign_case("seed-no-number", f"{BATCH} --hide x", "--hide", "x"),
    campaign_case("world-of-a-live-lab", "--out @/out --hide 3", "--hide", "--batch"),
    campaign_case("unknown-option", "--bach", "--bach"),
    campaign_case("next-trials-missing", f"{BATCH} --plan @/found.json", "found.json", "no such file"),
    case("out-is-no-campaign", campaign, "@/p.yaml --out @ --batch", "exists", "campaign.yaml", p__yaml=PLAN),
]

WORLDS = [
    world_case("unknown-effect", "effects: {ghost: {}}\n", "effects", "ghost"),
    world_case("unknown-parameter", "effects: {leg_slip: {sgma: 0.1}}\n", "leg_slip", "sgma"),
    world_case("unknown-key", "noize: {}\n", "noize", "noise"),
    world_case("nan", "delta_t_s: .nan\n", "delta_t_s", "nan"),
    world_case("out-of-range", "delta_t_s: -0.4\n", "delta_t_s", "-0.4"),
    campaign_case("world-missing", f"{BATCH} --world @/world.yaml", "world.yaml", "no such file"),
]

TABLES = [
    case("csv-a-plan", compare, "@/plan.yaml", "plan.yaml: not trials; a campaign folder, bags or", plan__yaml=PLAN),
    case("csv-a-result", discover, "@/first.json", "first.json: not trials; a campaign", first__json="{}"),
    csv_case("missing-column", "phi,omega_rad_s\n0.6,8\n", "row 1", "speed_m_s"),
    csv_case("no-unit", "phi,omega_rad_s,speed\n0.6,8,20\n", "row 1", "speed needs its unit"),
    csv_case("empty", "", "empty", "phi"),
    csv_case("only-a-header", HEADER, "no trials"),
    csv_case("nan-phi", GOOD + "nan,16,0.2\n", "row 4", "column phi", "nan"),
    csv_case("text-for-a-number", GOOD + "0.6,fast,0.2\n", "row 4", "column omega_rad_s", "fast"),
    csv_case("percent", GOOD + "63.3,16,0.2\n", "row 4", "column phi", "63.3", "100"),
    csv_case("short-row", GOOD + "0.6,16\n", "row 4", "2 values"),
    csv_case("not-text", b"\xff\xfe\x00\x80", "not a text file"),
    case("csv-missing", compare, "@/trials.csv --json @/out.json", "trials.csv", "no such file"),
    case("table-of-a-bad-csv", table, "@/a.csv --out @/out.csv", "a.csv", "row 2", "phi", a__csv=HEADER + "x,8,0.1\n"),
    case("table-of-nothing", table, "@/nowhere --out @/out.csv", "nowhere", "no such file"),
    case("table-of-an-empty-bag", table, "@/bag --out @/out.csv", "bag", bag=empty_bag),
    case("table-of-no-campaign", table, "@ --out @/out.csv", "@", note__txt="hello"),
    case("compare-no-campaign", compare, "@ --json @/out.json", "@", note__txt="hello"),
    case("compare-an-empty-bag", compare, "@/bag --json @/out.json", "bag", bag=empty_bag),
    case("discover-negative-size", discover, "@/t.csv --max-effects -1", "--max-effects", t__csv=GOOD),
]

EFFECTS = [
    case("unknown-base-model", compare, "@/t.csv --model best --json @/out.json", "invalid choice", t__csv=GOOD),
    case("unknown-effect", compare, "@/t.csv --effects ghost --json @/out.json", "ghost", "leg_slip", t__csv=GOOD),
    effects_file_case("syntax", "class Boost(:\n", "SyntaxError"),
    effects_file_case("raises", "1 / 0\n", "ZeroDivisionError"),
    effects_file_case("without-effect", "x = 1\n", "Effect"),
    case("effects-file-missing", effects, "--effects-from @/mine.py", "mine.py", "no such file"),
    formula_case("syntax", "boost: strength: k*(1 + a*; a [1] in -5..5", "boost"),
    formula_case("unknown-stage", "boost: strenth: k*(1 + a); a [1] in -5..5", "strenth", "strength"),
    formula_case("unknown-name", "boost: strength: k*(1 + a*ghost); a [1] in -5..5", "boost", "ghost"),
    formula_case("no-parameter", "boost", "boost"),
    formula_case("empty-range", "boost: strength: k*(1 + a); a [1] in 5..-5", "a"),
]

BAGS = [
    case("info-missing", info, "@/nowhere", "nowhere", "no such bag"),
    case("info-no-campaign", info, "@", "@", note__txt="hello"),
    case("recover-missing", recover, "@/nowhere @/new", "nowhere", "no such bag"),
    case("recover-onto-a-bag", recover, "@/bag @/other", "other", "exists", bag=small_bag, other=small_bag),
    case("recover-onto-itself", recover, "@/bag @/bag", "bag", "exists", bag=small_bag),
    case("recover-an-empty-bag", recover, "@/bag @/new", "bag", "empty", bag=empty_bag),
    case("recover-one-argument", recover, "@/bag", "NEW_BAG", bag=empty_bag),
]

VIDEOS = [
    case("video-missing", track_video, "@/top.mp4 --cameras @/c.yaml", "top.mp4", "no such", c__yaml=CAMERAS),
    case("video-unreadable", track_video, "@/t.mp4 --cameras @/c.yaml", "readable", c__yaml=CAMERAS, t__mp4="hello"),
    case("video-no-start", track_video, "@/t.mp4 --cameras @/c.yaml --start nan", "--start", "nan", c__yaml=CAMERAS),
    case("video-no-omega", track_video, "@/t.mp4 --cameras @/c.yaml --omega nan", "--omega", "nan", c__yaml=CAMERAS),
    case("cameras-missing", track_video, "@/t.mp4 --cameras @/c.yaml", "c.yaml", "no such file", t__mp4="hello"),
    case("cameras-without-lateral", track_video, "@/a @/b --cameras @/c.yaml", "lateral", c__yaml=CAMERAS),
    case("cameras-nan", track_video, "@/a --cameras @/c.yaml", "c.yaml", "dorsal", "fx", "nan", c__yaml=NO_FOCUS),
]


def points_case(name, text, *words):
    line = "@/p.csv --name dorsal --plane 0.05 --out @/out.yaml"
    return case(f"points-{name}", calibrate, line, "p.csv", *words, p__csv=text)


POINT_TABLES = [
    case("points-missing", calibrate, "@/p.csv --name dorsal --plane 0 --out @/out.yaml", "p.csv", "no such"),
    points_case("missing-column", POINTS.replace("z_m", "z_mm"), "z_m"),
    points_case("text", POINTS + "left,1,1,1,1\n", "row 9", "u_px", "left"),
    points_case("nan", POINTS + "1,1,nan,1,1\n", "row 9", "x_m", "nan"),
    points_case("too-few", "".join(POINTS.splitlines(keepends=True)[:4]), "3 points", "6"),
    case("points-in-a-line", calibrate, "@/p.csv --name dorsal --plane 0.05 --out @/o.yaml", "plane", p__csv=POINTS),
    case(
        "chessboard-unreadable",
        calibrate,
        "@/p.csv --name dorsal --plane 0 --out @/out.yaml --chessboard @/b.mp4",
        "b.mp4",
        p__csv=POINTS,
        b__mp4="hello",
    ),
]

SEALS = [
    case("unseal-no-discovery", unseal, "@", "discovery.json", "no such file", campaign__yaml=PLAN),
    case("unseal-no-campaign", unseal, "@", "world.yaml: is it a campaign of the virtual lab?", a__csv=GOOD),
    case("unseal-before-discover", unseal, "@", "make it with: trackway discover", **{"truth/world__yaml": ""}),
    case("unseal-missing", unseal, "@/nowhere", "nowhere", "no such file"),
    case("unseal-not-json", unseal, "@", "discovery.json", "not JSON", discovery__json="{"),
    case("unseal-a-file", unseal, "@/a.csv", "@/a.csv is a file, a folder is needed", a__csv=GOOD),
    case("unseal-other-schema", unseal, "@", "discovery.json", "sandbot.discovery/1", discovery__json="{}"),
    case("unseal-no-truth", unseal, "@", "world.yaml", "no such file", discovery__json=DISCOVERY, campaign__yaml=PLAN),
    case(
        "unseal-hollow-discovery",
        unseal,
        "@",
        "discovery.json",
        "steps",
        discovery__json=json.dumps({**json.loads(DISCOVERY), "steps": []}),
        campaign__yaml=PLAN,
        **{"truth/world__yaml": "schema: sandbot.world/1\n"},
    ),
]

GOOD_POINTS = "u_px,v_px,x_m,y_m,z_m\n" + "".join(
    # Pixels of CAMERAS' dorsal camera.
    f"{319.5 + 900 * (x - 0.3) / (1.5 - z)},{239.5 - 900 * y / (1.5 - z)},{x},{y},{z}\n"
    for x, y, z in (
        (0, 0, 0),
        (0.6, 0, 0),
        (0, 0.2, 0.1),
        (0.6, 0.2, 0),
        (0.3, -0.2, 0.2),
        (0.1, -0.1, 0.3),
        (0.5, 0.1, 0),
    )
)


def lens_case(name, line, *words, **files):
    command = f"@/p.csv --name dorsal --plane 0.05 {line}"
    return case(f"calibrate-{name}", calibrate, command, *words, p__csv=GOOD_POINTS, **files)


LENSES = [
    lens_case("size", "--out @/o.yaml --size -5 3", "--size", "-5"),
    lens_case("pattern", "--out @/o.yaml --chessboard @/b.avi --pattern 1 1", "--pattern", "1 1"),
    lens_case("square", "--out @/o.yaml --chessboard @/b.avi --square nan", "--square", "nan"),
    lens_case("onto-another-yaml", "--out @/o.yaml", "o.yaml", "lateral", "3", o__yaml="lateral: 3\n"),
]


def folder_and_table(name, tool, line, *words, **files):
    """Of trials.csv, in a folder that holds a folder ``sub``, too."""
    return case(name, tool, f"@/t.csv {line}", *words, t__csv=GOOD, **{"sub/note__txt": "hello"}, **files)


OTHERS = [
    folder_and_table("export-no-trial", export, "--out @/x.mp4", "--trial"),
    folder_and_table("export-no-such-trial", export, "--trial row_2 --out @/x.mp4", "row_2", "did you mean 'row2'"),
    folder_and_table("export-no-trial-like-it", export, "--trial nope --out @/x.mp4", "here; known: row2, row3"),
    folder_and_table("export-no-bag", export, "--trial row2 --out @/x.mp4", "'row2' is of a table"),
    folder_and_table("export-another-kind", export, "--trial row2 --out @/x.avi", "x.avi", ".rrd or .mp4"),
    folder_and_table("export-below-a-file", export, "--trial row2 --out @/t.csv/x.mp4", "t.csv is not a folder"),
    folder_and_table("export-unknown-effect", export, "--trial row2 --out @/x.mp4 --effects legslip", "'leg_slip'"),
    folder_and_table("export-unknown-option", export, "--trial row2 --out @/x.mp4 --efects leg_slip", "'--effects'"),
    case("export-a-folder", export, "@/sub --trial a --out @/x.mp4", "sub", "neither a campaign", **{"sub/a__txt": ""}),
    case("export-wrong-column", export, "@/w.csv --trial a --out @/x.mp4", "omega_rad_s", w__csv="phi,omega\n0.6,8\n"),
    case("export-no-text", export, "@/w.csv --trial a --out @/x.mp4", "w.csv", "not a text file", w__csv=b"\xff\x00"),
    folder_and_table("effects-of-a-folder", compare, "--effects-from @/sub", "sub", "is a folder"),
    folder_and_table("atlas-unknown-effect", atlas, "--effects legslip", "'leg_slip'"),
    folder_and_table("atlas-beside-nothing", atlas, "--beside @/none.csv", "none.csv", "no such file"),
    folder_and_table("atlas-into-a-file", atlas, "--out @/t.csv", "--out", "a folder is needed"),
    lens_case("points-are-a-folder", "--out @/o.yaml --intrinsics @", "is a folder"),
    lens_case("lens-of-another", "--out @/o.yaml --intrinsics @/t.csv", "t.csv", "key: value", t__csv=GOOD),
    lens_case("two-lenses", "--out @/o.yaml --intrinsics @/c.yaml --chessboard @/b.mp4", "choose one", c__yaml=CAMERAS),
    lens_case("no-such-camera", "--out @/o.yaml --name top", "top", "dorsal"),
    lens_case("one-too-many", "@/q.csv --out @/o.yaml", "q.csv", "too many"),
    lens_case("far-plane", "--out @/o.yaml --plane nan", "plane", "nan"),
    case("calibrate-a-folder", calibrate, "@ --name dorsal --plane 0.05 --out @/o.yaml", "is a folder", a__txt=""),
    case("pressed-at-nan", penetrometer, "--phi nan --out @/o.csv", "phi", "nan"),
    case("pressed-at-nothing", penetrometer, "--out @/o.csv", "--phi"),
    case("pressed-in-no-world", penetrometer, "--phi 0.6 --out @/o.csv --world @/w.yaml", "w.yaml", "no such file"),
    case("devices-in-a-file", simulate, "@/t.csv", "t.csv is a file, a folder is needed", t__csv=GOOD),
    case("devices-without-a-camera", simulate, "@/d --cameras @/c.yaml", "c.yaml", "lateral", c__yaml=CAMERAS),
    case("devices-of-no-seed", simulate, "@/d --seed -1", "--seed", "-1"),
    case("devices-of-no-trial-seed", simulate, "@/d --trial-seed -1", "--trial-seed", "-1"),
    case("devices-on-no-ground", simulate, "@/d --phi nan", "--phi", "nan"),
    case("devices-without-a-lease", simulate, "@/d --lease 0", "--lease", "0"),
]

# Where a result can't go is told before the work is done.
OUTPUTS = [
    case("json-is-a-folder", compare, "@/t.csv --json @", "--json", "@", "folder", t__csv=GOOD),
    case("html-is-a-folder", compare, "@/t.csv --json @/o.json --html @", "--html", "@", "folder", t__csv=GOOD),
    case("json-below-a-file", discover, "@/t.csv --json @/t.csv/o.json", "--json", "@/t.csv", t__csv=GOOD),
    case("effects-json-is-a-folder", effects, "--json @", "--json", "@", "folder"),
    case("table-is-a-folder", table, "@/t.csv --out @", "@", "can't be written", t__csv=GOOD),
    case("table-below-a-file", table, "@/t.csv --out @/t.csv/o", "@/t.csv/o", "can't be written", t__csv=GOOD),
    case("table-no-workers", table, "@/t.csv --workers 0 --out @/o.csv", "--workers", "0", t__csv=GOOD),
    lens_case("below-a-file", "--out @/p.csv/o.yaml", "@/p.csv/o.yaml", "can't be written"),
]

CASES = [*PLANS, *WORLDS, *TABLES, *EFFECTS, *BAGS, *VIDEOS, *POINT_TABLES, *LENSES, *OTHERS, *OUTPUTS, *SEALS]


def fill(folder: Path, files) -> None:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if callable(content):
            content(path)
        else:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())


def snapshot(folder: Path) -> dict[str, bytes | None]:
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.fixture
def run(monkeypatch, capsys):
    """Run a tool by its name and return its exit code and what it wrote to stdout and stderr."""

    def _run(tool: ModuleType, argv: list[str]) -> tuple[int, str, str]:
        name = tool.__name__.rpartition(".")[2]
        monkeypatch.setattr("sys.argv", [f"/somewhere/{name}", *argv])
        code = tool.main(argv)
        out, err = capsys.readouterr()
        return code, out, err

    return _run


@pytest.mark.parametrize("given", CASES, ids=lambda given: given.name)
def test_one_line_says_what_is_wrong_and_nothing_is_written(given, tmp_path, run):
    fill(tmp_path, given.files)
    before = snapshot(tmp_path)
    code, out, err = run(given.tool, given.argv(tmp_path))
    name = given.tool.__name__.rpartition(".")[2]
    assert (code, out) == (2, ""), err
    assert err.count("\n") == 1
    assert err.endswith("\n")
    assert err.startswith(f"{name}: error: ")
    missing = [word for word in given.words if word.replace("@", str(tmp_path)).lower() not in err.lower()]
    assert not missing, err
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("tool", sorted({given.tool for given in CASES}, key=lambda tool: tool.__name__))
def test_help_is_plain_text_and_explains_each_option(tool, capsys):
    with pytest.raises(SystemExit):
        tool.main(["--help"])
    said = capsys.readouterr().out
    assert "``" not in said
    assert "; default: " not in re.sub(r"\([^)]*\)", "", said)
    options = re.findall(r"^  (-.*(?:\n {24}.*)?)", said, re.MULTILINE)
    assert options
    assert [option for option in options if not re.search(r"\S(  |\n)\s*\w", option)] == []


def test_good_input_passes_the_same_gate(tmp_path, run):
    # The negative control of the cases above: the files they spoil are good as they stand.
    fill(
        tmp_path,
        {"plan.yaml": PLAN, "t.csv": GOOD + "0.6,8,0.12\n0.6,8,0.13\n", "bag": small_bag, "p.csv": GOOD_POINTS},
    )
    assert run(campaign, [str(tmp_path / "plan.yaml"), "--dry-run"])[0] == 0
    assert run(table, [str(tmp_path / "t.csv"), "--out", str(tmp_path / "out.csv")])[0] == 0
    assert run(info, [str(tmp_path / "bag")])[0] == 0
    points = ["--name", "dorsal", "--plane", "0.05", "--out", str(tmp_path / "c.yaml")]
    assert run(calibrate, [str(tmp_path / "p.csv"), *points])[0] == 0
    assert run(effects, ["--effect", "boost: strength: k*(1 + a*(phi-0.6)); a [1] in -5..5"])[0] == 0
    assert run(recover, [str(tmp_path / "bag"), str(tmp_path / "new")])[0] == 0


def test_unseal_agrees_where_the_seal_and_the_discovery_are_whole(tmp_path, run):
    world = "schema: sandbot.world/1\n"
    fill(tmp_path, {"campaign.yaml": PLAN, "discovery.json": DISCOVERY, "truth/world.yaml": world})
    assert run(unseal, [str(tmp_path)])[0] == 0


@pytest.mark.slow
def test_libraries_below_keep_quiet_about_a_bad_video(tmp_path):
    # In a process of its own: FFmpeg writes past Python's stderr.
    fill(tmp_path, {"top.mp4": "hello", "c.yaml": CAMERAS})
    start = "import sys; from sandbot_tracking.tools.track_video import main; sys.exit(main())"
    command = [sys.executable, "-c", start, str(tmp_path / "top.mp4"), "--cameras", str(tmp_path / "c.yaml")]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert "top.mp4: not a readable video" in ended.stderr


def test_one_row_is_a_table_but_shows_nothing(tmp_path, run):
    # Not bad input: the verdict is never forced, and says why it can't be more.
    fill(tmp_path, {"t.csv": HEADER + "0.633,16,0.203\n"})
    found = tmp_path / "found.json"
    code, out, _ = run(
        discover, [str(tmp_path / "t.csv"), "--json", str(found), "--workers", "1", "--max-effects", "0"]
    )
    verdict = json.loads(found.read_text())["verdict"]
    assert (code, verdict["status"], verdict["effects"]) == (0, "untested", [])
    assert "1 cell mean can't test the 3 parameters of the base model" in " ".join(out.split())


def test_info_reports_on_a_file_that_is_no_bag(tmp_path, run):
    # info describes damage, so that recover can be tried; its exit code says so.
    fill(tmp_path, {"bag.mcap": "hello"})
    code, out, _ = run(info, [str(tmp_path / "bag.mcap")])
    assert code == 1
    assert "not the first bytes of an MCAP file" in out


@pytest.mark.parametrize("batch", [[], ["--dry-run"]])
def test_no_live_campaign_begins_before_the_hosts_clock_is_set(tmp_path, monkeypatch, capsys, batch):
    """Its trials would be put before all others; what runs no trial may be asked for at any time."""
    monkeypatch.setattr(campaign, "time", SimpleNamespace(time=lambda: 62.0))
    (tmp_path / "plan.yaml").write_text(PLAN)
    command = [str(tmp_path / "plan.yaml"), "--out", str(tmp_path / "out"), *batch]
    assert campaign.main(command) == (0 if batch else 2)
    said = capsys.readouterr().err
    assert ("error: the host's clock shows 1970-01-01, so it has not been set yet" in said) is not bool(batch)
    assert said.count("\n") == (0 if batch else 1)
    assert not (tmp_path / "out").exists()
