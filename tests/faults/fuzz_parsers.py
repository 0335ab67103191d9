"""Every parser a user's file or text meets, each with good files to be spoilt."""

import json
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from urllib.parse import urlencode

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit" / "sandbot_record"))
from bags import trial_bag

from sandbot_bringup.config import config_folder, files_of
from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.journal import Journal
from sandbot_bringup.plan import read_plan, trials_of, with_block, with_next_trials
from sandbot_bringup.queue import Queue
from sandbot_bringup.tools import unseal
from sandbot_bringup.until import looks_of
from sandbot_common.errors import InputError
from sandbot_common.robot import read_robot
from sandbot_lab.world import null_world, read_world, write_world
from sandbot_model.data.conditions import cells_of
from sandbot_model.data.penetrometer import read_readings
from sandbot_model.data.quality import checked
from sandbot_model.discovery.selection import from_query, read_selection
from sandbot_model.physics.formula import formula_effect
from sandbot_model.predictor_parameters import predictor_from_json
from sandbot_model.tools import discover
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.recover import recover
from sandbot_record.bags.writer import BagWriter
from sandbot_record.trials.from_bags import trial_from_bag
from sandbot_record.trials.read import read
from sandbot_tracking.calibration import read_cameras
from sandbot_tracking.tools.calibrate import read_table as read_points

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Parser:
    """``read`` takes a file of that name; ``seeds`` gives good contents, with a folder in which they can be made."""

    name: str
    file: str
    read: Callable[[Path], object]
    seeds: Callable[[Path], Sequence[bytes]]
    share: int = 1
    """Cases, in parts of what the slowest parser gets."""
    names_file: bool = True
    """Whether what it refuses is named by its file: a formula and an address have none."""


def plan(path: Path) -> None:
    """As ``campaign`` does before anything moves."""
    found = read_plan(path)
    files_of(found, path.parent, path.parent / "none")
    if found.replicates * len(found.phi) * len(found.omega_rad_s) < 5000:
        trials_of(found)


def table(path: Path) -> None:
    """As ``compare`` does before any fit."""
    trials = read(path)
    checked(trials)
    cells_of(trials)


def bag(path: Path) -> None:
    """As ``table`` and ``recover`` do; what one can't read the other may."""
    target = path.with_name("recovered")
    shutil.rmtree(target, ignore_errors=True)
    both(path, trial_from_bag, lambda path: recover(path, target))


def message(path: Path) -> None:
    """The trial's bag, whole but for what one topic's messages say: ``TOPIC\n`` and bytes that stand for each tenth."""
    name, _, payload = path.read_bytes().partition(b"\n")
    target = path.with_name("spoilt")
    shutil.rmtree(target, ignore_errors=True)
    with BagWriter(target) as writer:
        for number, one in enumerate(_trial(path.parent).messages()):
            writer.add_topic(one.topic, one.type)
            other = one.topic.encode() == name and (number % 10 == 0 or one.topic in ("/trial", "/sync_led"))
            writer.write(one.topic, payload if other else one.data, one.log_time_ns, one.publish_time_ns, number)
    trial_from_bag(target)


def discovery(path: Path) -> None:
    """As ``campaign --plan``, the predictor and ``unseal`` do."""
    both(
        path,
        lambda path: with_next_trials(read_plan(config_folder() / "demo.yaml"), path),
        lambda path: predictor_from_json(path, None, None),
        lambda path: unseal.command([str(_sealed(path)), "--discovery", str(path)]),
    )


def journal(path: Path) -> None:
    """As a campaign that is resumed does."""
    Queue(read_plan(config_folder() / "demo.yaml"), (), Journal(path, lambda: 0.0).earlier)


def looks(path: Path) -> None:
    """As a campaign until a verdict does when it is resumed."""
    given = read_plan(config_folder() / "demo.yaml")
    for entry in looks_of(CampaignFolder(path.parent)):
        trials_of(with_block(given, entry["next"]))


def both(path: Path, *readers: Callable[[Path], object]) -> None:
    """All readers; the first refusal is raised, but only after each has had its turn."""
    refused = []
    for reader in readers:
        try:
            reader(path)
        except InputError as error:
            refused.append(error)
    if refused:
        raise refused[0]


def text(path: Path) -> str:
    """What was typed; bytes that are no text are none that can be."""
    return path.read_bytes().decode("utf-8", "ignore")


def config(*names: str) -> Callable[[Path], list[bytes]]:
    """The project's own files."""
    return lambda _: [(config_folder() / name).read_bytes() for name in names]


def _sealed(path: Path) -> Path:
    folder = path.parent / "sealed"
    if not folder.is_dir():
        (folder / "truth").mkdir(parents=True)
        write_world(null_world(), folder / "truth" / "world.yaml")
        shutil.copy(config_folder() / "demo.yaml", folder / "campaign.yaml")
    return folder


def _plans(folder: Path) -> list[bytes]:
    custom = b"""name: all\nphi: [0.6, 0.62]\nomega_rad_s: [8, 20]\ngait: CUSTOM
gait_parameters: {theta_s_rad: 1.1, theta_0_rad: 0.2, duty: 0.5}\nbed: {fluidise_s: 2.0, pulse_off_s: 0.5}
extra_trials: [{phi: 0.61, omega_rad_s: 9, replicates: 2, round: 2, gait: SGCS, because: why}]\norder: as_listed
sentinel: 3\nimages: none\nrobot: ''\ncameras: ''\n"""
    return [*config("demo.yaml", "li09.yaml", "pilot.yaml")(folder), custom]


def _tables(_: Path) -> list[bytes]:
    lines = (ROOT / "examples" / "demo_trials.csv").read_bytes().splitlines(keepends=True)
    foreign = b"# from a figure\nphi [%];frequency [Hz];mean speed [cm/s];day;lift [mm]\n"
    foreign += b"".join(b"%.1f;%.1f;%.2f;mon;%.1f\n" % (58 + n / 3, 1 + n / 4, 3 * n, n) for n in range(12))
    return [b"".join(lines[:40]), lines[0] + b"".join(lines[60::12]), foreign]


@cache
def _trial(folder: Path) -> Bag:
    """A trial as the tests make them."""
    path = folder / "trial"
    return Bag.open(path if path.exists() else trial_bag(path))


def _messages(folder: Path) -> list[bytes]:
    """One message of each topic, and all kinds of /trial."""
    found = {one.topic: one.topic.encode() + b"\n" + one.data for one in _trial(folder).messages()}
    trial = found["/trial"]
    return [*found.values(), trial, trial, trial]


def _bags(folder: Path) -> list[bytes]:
    """A trial's file: whole, cut, and without its middle."""
    (file,) = _trial(folder).files
    whole = file.read_bytes()
    return [whole, whole[: len(whole) // 2], whole[:4000] + whole[-4000:]]


@cache
def _discoveries(folder: Path) -> list[bytes]:
    """What ``discover`` writes of the example: its heart, and only what is asked for next."""
    out = folder / "found.json"
    if discover.main([str(ROOT / "examples" / "demo_trials.csv"), "--max-effects", "0", "--json", str(out)]) != 0:
        raise RuntimeError("no discovery to begin with")
    whole = json.loads(out.read_bytes())
    asked = [{"phi": 0.6, "omega_rad_s": 8, "replicates": 2, "observable": "lift", "separates": ["a", "b"]}]
    heart = {key: whole[key] for key in ("schema", "model", "robot", "verdict", "noise_floor_m_s") if key in whole}
    heart["steps"] = [{**step, "fails": [], "residuals": []} for step in whole["steps"]]
    return [json.dumps({**heart, "next_trials": asked}).encode(), json.dumps({"next_trials": asked}).encode()]


FORMULAS = (
    "boost: strength: k*(1 + a*(phi - 0.6)); a [1] in -5..5",
    "brake: balance: extra_force = c*omega; c [N s] in 0..0.1",
    "slip: speed: kept, peak *= 1 - a*d/R; a [1] in 0..1",
    "late: clock: omega*where(phi > 0.6, min(1, a), exp(-b)); a in 0..2; b in 0..1",
)
_ADDRESSES = (
    b"?model=full&effect=leg_slip&hold=leg_slip.sigma%3D0.1&cell=3&view=speed&observable=speed",
    b"?" + urlencode([("formula", FORMULAS[0]), ("effect", "boost"), ("against", "?model=full")]).encode(),
)
_SELECTION = f"""schema: sandbot.selection/1\ncommand: compare x.csv --model simple\nmodel: simple
effects: [leg_slip, boost]\nformulas: ['{FORMULAS[0]}']\nby_hand: {{leg_slip.sigma: 0.1}}\nresult: {{rmse: 0.1}}\n"""
_JOURNAL = (
    b'{"at": "2026-01-01T00:00:00+00:00", "who": "campaign", "do": "start", "trial_id": "phi0.5800_w04.000_r01"}\n'
    b'{"at": "2026-01-01T00:00:09+00:00", "who": "operator", "do": "skip", "trial_id": "phi0.5800_w08.000_r01"}\n'
    b'{"at": "2026-01-01T00:00:09+00:00", "who": "operator", "do": "repeat", "trial_id": "phi0.5800_w04.000_r01"}\n'
    b'{"at": "2026-01-01T00:00:09+00:00", "who": "campaign", "do": "done", "trial_id": "phi0.5800_w04.000_r01", '
    b'"seconds": 9.0, "measured": {"phi": 0.58}}\n'
)
_LOOKS = b'{"look": 1, "planned": 12, "finished": 12, "text": "go on", "next": [{"phi": 0.6, "omega_rad_s": 8}]}\n' * 2
_POINTS = b"u_px,v_px,x_m,y_m,z_m\n" + b"".join(b"%d,%d,0.%d,0.1,0.2\n" % (10 * n, 20 * n, n) for n in range(1, 9))
_READINGS = b"phi,depth_m,force_n,force_sd_n\n0.58,0.02,3.1,0.1\n0.6,0.02,4.1,0.1\n0.62,0.03,6,0.2\n"

PARSERS = (
    Parser("plan", "campaign.yaml", plan, _plans, 10),
    Parser("world", "world.yaml", read_world, config("li09_world.yaml", "outside_world.yaml", "pilot_world.yaml"), 10),
    Parser("robot", "robot.yaml", read_robot, config("robot.yaml", "sgcs_robot.yaml"), 10),
    Parser("cameras", "cameras.yaml", read_cameras, config("cameras.yaml"), 10),
    Parser("table", "trials.csv", table, _tables, 10),
    Parser("bag", "trial.mcap", bag, _bags, 5),
    Parser("message", "message.bin", message, _messages, 2),
    Parser("formula", "formula.txt", lambda path: formula_effect(text(path)),
           lambda _: [one.encode() for one in FORMULAS], 15, names_file=False),
    Parser("selection", "selection.yaml", read_selection, lambda _: [_SELECTION.encode()], 10),
    Parser("address", "address.txt", lambda path: from_query(text(path)), lambda _: list(_ADDRESSES), 10,
           names_file=False),
    Parser("discovery", "discovery.json", discovery, _discoveries, 5),
    Parser("journal", "journal.jsonl", journal, lambda _: [_JOURNAL], 5),
    Parser("looks", "looks.jsonl", looks, lambda _: [_LOOKS], 5),
    Parser("points", "points.csv", read_points, lambda _: [_POINTS], 5),
    Parser("penetrometer", "readings.csv", read_readings, lambda _: [_READINGS], 5),
)  # fmt: skip
