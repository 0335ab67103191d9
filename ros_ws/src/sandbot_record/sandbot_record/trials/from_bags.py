"""The trials table from bags, one row per bag; campaigns are read in parallel, and skipped bags listed with reasons.

The rows of a campaign are cached next to its trials (``cache``), so that only new or changed bags are read again.
"""

import math
from collections.abc import Container, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from sandbot_common import delimited_text, files, topics
from sandbot_common.arrays import Floats
from sandbot_common.errors import InputError
from sandbot_common.host_clock import never_set
from sandbot_common.legs import FARTHEST_RAD, leg_mount_rad
from sandbot_common.parallel import Workers, one_per_cpu
from sandbot_common.robot import FILE, SANDBOT, Robot
from sandbot_common.typed import number_or_nan
from sandbot_record.bags import reader
from sandbot_record.bags.reader import FIELD_STAMP, Bag
from sandbot_record.trials import judge, publishers
from sandbot_record.trials.cache import CACHE as CACHE
from sandbot_record.trials.cache import Cache, Measured, content_hash, files_of
from sandbot_record.trials.csv_table import read_csv, write_csv
from sandbot_record.trials.header import foreign
from sandbot_record.trials.legs import leg_columns
from sandbot_record.trials.setting import Setting, of_bag, of_campaign, shared
from sandbot_record.trials.table import MEASURED, OK, Row, Trials, from_rows
from sandbot_tracking.trial import TrialSummary, summarise

TRIALS_CSV = "trials.csv"
UNREADABLE = "its bag can't be read any more"
"""Status of a row of trials.csv that was measured before its bag was damaged."""
_POINT = ("point.x", "point.y", "point.z")
_PARALLEL_FROM = 8
"""Number of bags from which starting worker processes pays."""
_CACHE_EVERY = 1000
"""Bags after which the cache is written, so that an interrupted table of very many bags resumes from there."""


@dataclass(frozen=True)
class Report:
    """The table of a campaign, the bag of each trial whose bag can be read, the reason for each skipped bag, how many
    rows came from the cache, and whether the table was edited manually."""

    trials: Trials
    bags: Mapping[str, Path]
    skipped: Mapping[Path, str]
    cached: int
    edited: bool = False


def row_from_bag(path: Path) -> Row:
    """The row of one trial's bag; see `trial_from_bag`."""
    return _measured(path)[0]


def trial_from_bag(path: Path) -> Trials:
    """The table of one trial. Raises InputError if the bag is unreadable, unfinished or names no trial.

    What could not be measured is NaN, and status gives the reason.
    """
    row, setting = _measured(path)
    return from_rows([row], *setting.for_table)


def _measured(path: Path) -> Measured:
    """As `trial_from_bag`; errors about a message of the bag name the bag."""
    try:
        return _read(path)
    except InputError as error:
        named = str(error).startswith((f"{path}: ", f"{path}/"))
        raise InputError(str(error) if named else f"{path}: {error}") from None


def _read(path: Path) -> Measured:
    bag = Bag.open(path)
    if not bag.count:
        raise InputError(f"{path}: empty bag, no messages")
    plan, bed = plan_of(bag), _bed(bag)
    row = Row(
        trial_id=str(plan.get("trial_id") or files.base_name(path)),
        phi=_last(bag, topics.BED_PHI.name),
        phi_sd=_phi_sd(bed),
        omega_rad_s=number_or_nan(plan.get("omega_rad_s")),
        gait=_gait(plan.get("gait")),
        replicate=number_or_nan(plan.get("replicate")),
        batch=str(plan.get("batch") or ""),
        run_order=number_or_nan(plan.get("run_order")),
        started=_started(bag, plan),
    )
    exit_status = _exit_status(bag)
    setting = of_bag(bag, plan, math.nan)
    try:
        summary, frame_rate_hz = _summary(bag, _robot(plan, setting))
    except InputError as error:
        return replace(row, status=str(error).removeprefix(f"{path}: ")), setting
    row = replace(row, **{name: getattr(summary, name) for name in (*MEASURED, "speed_sd_m_s")})
    begun_ns = start_ns(bag)
    ready = [(t_ns, number_or_nan(values.get("phi"))) for t_ns, values in bed if values.get("stage") == "ready"]
    fault = publishers.fault(bag, begun_ns, ready) or judge.fault(bag, begun_ns, row.omega_rad_s)
    row = replace(row, status=_status(row, exit_status, fault, summary.reason))
    return row, replace(setting, frame_rate_hz=frame_rate_hz)


def not_measured(bag: Bag) -> str:
    """What of a trial was not measured, and why; empty if all was. Raises InputError if the bag is not of a trial."""
    plan = plan_of(bag)
    return _summary(bag, _robot(plan, of_bag(bag, plan, math.nan)))[0].reason


def _robot(plan: dict[str, Any], setting: Setting) -> Robot:
    return replace(setting.robot or SANDBOT, leg_mount_rad=_leg_mount_rad(plan, setting.robot))


def _leg_mount_rad(plan: dict[str, Any], robot: Robot | None) -> float:
    """The legs' mount angle [rad] from /trial, else from the robot; if both give it, they must agree. Bags of earlier
    versions have it in /trial alone."""
    if "leg_mount_rad" not in plan:
        return robot.leg_mount_rad if robot else 0.0
    mount = leg_mount_rad(plan, topics.TRIAL.name)
    if robot is not None and mount != robot.leg_mount_rad:
        raise InputError(
            f"{topics.TRIAL.name}: leg_mount_rad {mount:g} is not that of the robot, {robot.leg_mount_rad:g}"
        )
    return mount


def campaign(folder: Path, workers: Workers | None = None) -> Report:
    """The table of a campaign folder, or of any folder of bags.

    Bags are read by ``workers`` (by default one process per CPU); a folder with only trials.csv gives that table. A
    trial's status may be edited in trials.csv: edits apply to all bags that are unchanged since it was written. A row
    whose bag can't be read any more is kept but excluded. Raises InputError if there is no row.
    """
    report = report_of(folder, workers)
    if not len(report.trials):
        first = next(iter(report.skipped.values()))
        raise InputError(f"{folder}: none of {len(report.skipped)} bags gives a row; the first: {first}")
    return report


def report_of(folder: Path, workers: Workers | None = None) -> Report:
    """As `campaign`, but without an error if no bag gives a row."""
    bags = bags_in(folder)
    if not bags:
        if (folder / TRIALS_CSV).is_file():
            return Report(table_of(folder / TRIALS_CSV), {}, {}, 0)
        raise InputError(f"{folder}: neither a campaign (trials/<trial_id>/ or {TRIALS_CSV}) nor a bag")
    recorded, cache = of_campaign(folder), Cache.read(folder)
    own = read_csv(folder / TRIALS_CSV) if (folder / TRIALS_CSV).is_file() else None
    edited = own is not None and content_hash(folder / TRIALS_CSV) != cache.written
    tabled = _tabled(folder, bags, cache) - _lost_before(own, bags) if own else set()
    if own and len(own) == len(bags) == len(tabled) and not isinstance(first_bag := _row_or_reason(bags[0]), str):
        table = replace(from_rows(own.rows(), *shared([recorded, first_bag[1]]).for_table), unread=own.unread)
        if cache.changed:
            cache.write({bag: cache.key(bag) for bag in bags})
        return Report(table, {cache.trial_id(bag): bag for bag in bags}, {}, len(bags), edited)
    keys = {bag: cache.key(bag) for bag in bags}
    cached = sum(key in cache.measured for key in keys.values())
    failed = _fill(cache, keys, workers)
    if cached == len(bags) and cache.changed:
        cache.write(keys)
    found = {bag: result for bag in bags if (result := cache.get(keys[bag], bag)) is not None}
    by_id = _by_id({bag: row for bag, (row, _) in found.items()})
    doubled = {bag: _same_id(bag, row, by_id) for bag, (row, _) in found.items() if by_id[row.trial_id] != bag}
    settings = [setting for bag, (_, setting) in found.items() if bag not in doubled]
    measured = {bag: row for bag, (row, _) in found.items() if bag not in doubled}
    rows = _lost(own, failed, by_id) | _as_edited(measured, own if edited else None, tabled)
    unread = (*(own.unread if own else ()), *_edits([rows[bag] for bag in measured], list(measured.values())))
    table = from_rows([rows[bag] for bag in sorted(rows)], *shared([recorded, *settings]).for_table)
    return Report(replace(table, unread=unread), by_id, failed | doubled, cached, edited)


def _as_edited(measured: Mapping[Path, Row], by_hand: Trials | None, tabled: Container[Path]) -> dict[Path, Row]:
    """The measured rows, those that are ``tabled`` as the table has them that was edited ``by_hand``: one without edits
    is ignored, as an earlier version may have measured it from the bags."""
    edited = {row.trial_id: row for row in by_hand.rows()} if by_hand else {}
    return {bag: edited.get(row.trial_id, row) if bag in tabled else row for bag, row in measured.items()}


def _lost_before(own: Trials, bags: Iterable[Path]) -> set[Path]:
    """Bags that could not be read when the table was written: it does not decide what they are if they can be now."""
    lost = {row.trial_id for row in own.rows() if row.status == UNREADABLE}
    return {bag for bag in bags if files.base_name(bag) in lost}


def _lost(own: Trials | None, failed: Iterable[Path], found: Container[str]) -> dict[Path, Row]:
    """Rows of the table whose bags can't be read any more."""
    known = {row.trial_id: row for row in own.rows() if row.trial_id not in found} if own else {}
    lost = {bag: known[name] for bag in failed if (name := files.base_name(bag)) in known}
    return {bag: replace(row, status=UNREADABLE if row.status == OK else row.status) for bag, row in lost.items()}


def _fill(cache: Cache, keys: Mapping[Path, str], workers: Workers | None) -> dict[Path, str]:
    """Read the bags that the cache does not have; the reasons for those that give no row."""
    todo = [bag for bag, key in keys.items() if key not in cache.measured]
    failed: dict[Path, str] = {}
    for first in range(0, len(todo), _CACHE_EVERY):
        part = todo[first : first + _CACHE_EVERY]
        for bag, result in zip(part, _measure_all(part, workers), strict=True):
            if isinstance(result, str):
                failed[bag] = result
            elif not keys[bag]:
                failed[bag] = f"{bag}: its files could not be read a moment ago"
            else:
                cache.measured[keys[bag]] = result
        cache.write(keys)
    return failed


def table_of(path: Path) -> Trials:
    """The trials of a CSV. One beside a campaign's trials.csv has the robot and cameras of that campaign's robot.yaml
    and cameras.yaml, as its folder has. Raises InputError."""
    table = read_csv(path)
    if not _is_of_campaign(path):
        return table
    setting = of_campaign(path.parent)
    return replace(table, robot=setting.robot, frame_rate_hz=setting.frame_rate_hz, accuracy=setting.accuracy)


def robot_file(data: Path) -> Path | None:
    """The robot.yaml from which a table of trials, or a folder with nothing but that, has its robot; None: there is
    none, or ``data`` are bags, which have their own."""
    path = data / TRIALS_CSV if data.is_dir() and not bags_in(data) else data
    found = path.parent / FILE
    return found if path.is_file() and not reader.is_bag(path) and _is_of_campaign(path) and found.is_file() else None


def _is_of_campaign(path: Path) -> bool:
    return (path.parent / TRIALS_CSV).is_file()


def make(folder: Path, workers: Workers | None = None, out: Path | None = None) -> Report:
    """Write the trials table of a campaign folder to ``out``, by default its trials.csv; see `check_no_column_lost`."""
    path = out or folder / TRIALS_CSV
    check_no_column_lost(path)
    report = campaign(folder, workers)
    with files.writing(path):
        write_csv(report.trials, path)
    if not files.same_file(path, folder / TRIALS_CSV):
        return report
    cache = Cache.read(folder)
    keys = {bag: cache.key(bag) for bag in bags_in(folder)}
    cache.tabled = {keys[bag] for bag in report.bags.values()}
    cache.written = "" if report.edited else content_hash(path)
    cache.write(keys)
    return report


def check_no_column_lost(out: Path) -> Path:
    """``out``. Raises InputError if it is a table with columns that overwriting would delete."""
    if out.is_file() and (columns := foreign(delimited_text.read_csv(out)[0])):
        raise InputError(
            f"{out}: has columns that a trials table has no place for ({', '.join(columns)}) and would lose them; "
            "write the table into another file (table --out)"
        )
    return out


def bags_in(folder: Path) -> list[Path]:
    """The bags of a campaign (``trials/*``) or of any folder (``*``), by name; empty if it does not exist.

    Each folder in ``trials`` is a trial's: one that has lost its files is included, so that reading it says so.
    """
    trials = folder / "trials"
    inside = trials if trials.is_dir() else folder
    if not inside.is_dir():
        return []
    # A folder with storage files of several bags is included: reading it raises an error.
    return sorted(
        path
        for path in inside.iterdir()  # a glob would pass over a folder that may not be read
        if not path.name.startswith(".")
        and (reader.is_bag(path) or reader.storage_files(path) or (inside == trials and path.is_dir()))
    )


def _tabled(folder: Path, bags: Sequence[Path], cache: Cache) -> set[Path]:
    """The bags unchanged since trials.csv was written; without a cache, those older than trials.csv."""
    if cache.tabled:  # preferred, as the clock may have been set since
        return {bag for bag in bags if cache.key(bag) in cache.tabled}
    written_ns = (folder / TRIALS_CSV).stat().st_mtime_ns
    return {bag for bag in bags if _last_change_ns(bag) <= written_ns}


def _last_change_ns(bag: Path) -> float:
    """When a bag was last changed; infinite if its files can't be read."""
    try:
        return max((file.stat().st_mtime_ns for file in files_of(bag)), default=0)
    except OSError:
        return math.inf


def _edits(rows: Sequence[Row], measured: Sequence[Row]) -> list[str]:
    """A note on rows that differ from their bags; compared as text, because NaN is not equal to itself."""
    ids = [row.trial_id for row, own in zip(rows, measured, strict=True) if repr(row) != repr(own)]
    some = ", ".join(ids[:3]) + (" …" if len(ids) > 3 else "")
    return [f"{TRIALS_CSV} differs from the bags of {some}, and is used"] if ids else []


def _measure_all(bags: Sequence[Path], workers: Workers | None) -> list[Measured | str]:
    """For each bag its row and setting, or the reason why there is none."""
    if len(bags) < _PARALLEL_FROM:
        return [_row_or_reason(bag) for bag in bags]
    with (workers or one_per_cpu()).map() as spread:
        return list(spread(_row_or_reason, bags))


def _row_or_reason(bag: Path) -> Measured | str:
    try:
        return _measured(bag)
    except InputError as error:
        return str(error)
    except OSError as error:  # of a folder that may not be entered, or on a disk that is gone
        return f"{error.filename or bag}: {error.strerror}"


def _started(bag: Bag, plan: dict[str, Any]) -> str:
    """When the trial was run; empty for a simulated one, or if the host's clock was not set yet."""
    start = str(plan.get("start") or "")
    unknown = bag.provenance.get("trial", {}).get("clock") == "simulated"
    with suppress(ValueError):
        unknown = unknown or never_set(datetime.fromisoformat(start))
    return "" if unknown else start


def _exit_status(bag: Bag) -> str:
    """How the trial ended; a bag that was recovered only in part is excluded until a person has judged it."""
    if bag.provenance.get("recovery", {}).get("lost", "nothing") != "nothing":
        return "recovered, parts are lost"
    return bag.provenance.get("trial", {}).get("exit_status", OK)


def plan_of(bag: Bag) -> dict[str, Any]:
    """The trial's parameters from /trial, else from the provenance record. Raises InputError if there is neither."""
    texts = [message.decode().data for message in bag.messages([topics.TRIAL.name])]
    texts += [bag.provenance.get("trial", {}).get("parameters", "")]
    if not texts[0]:
        raise InputError(f"{bag.path}: no message on {topics.TRIAL.name} and no trial metadata: which trial is it?")
    plan = files.parse_json(texts[0], f"{bag.path}: {topics.TRIAL.name}")
    if not isinstance(plan, dict):
        raise InputError(f"{bag.path}: {topics.TRIAL.name}: expected a JSON object, got {plan!r}")
    return plan


def _summary(bag: Bag, robot: Robot) -> tuple[TrialSummary, float]:
    """The measured summary, and the frame rate [Hz] (NaN for fewer than two frames)."""
    zero_ns = start_ns(bag)
    com, front, rear = _landmarks(bag)
    frames = np.unique(np.concatenate([com[0], front[0], rear[0]]))
    legs = leg_columns(bag, topics.LEG_STATES.name, robot.leg_order, "position", *FIELD_STAMP)
    leg_ns, first = np.unique(legs.stamp_ns, return_index=True)
    summary = summarise(
        (frames - zero_ns) * 1e-9,
        _aligned(frames, *com, 0),
        _aligned(frames, *front, 2),
        _aligned(frames, *rear, 2),
        (leg_ns - zero_ns) * 1e-9,
        _within(FARTHEST_RAD, legs["position"][first]),
        robot=robot,
    )
    return summary, round(1e9 / float(np.median(np.diff(frames))), 1) if len(frames) > 1 else math.nan


def _landmarks(bag: Bag) -> list[tuple[Any, Floats]]:
    """Stamps [ns] and positions (n, 3) [m; trackway frame] of com, front and rear axle."""
    found = []
    for topic in topics.LANDMARKS.values():
        columns = bag.columns(topic.name, *_POINT, *FIELD_STAMP)
        xyz = np.column_stack([columns[name] for name in _POINT])
        found.append((columns.stamp_ns, _within(judge.FAR_M, xyz)))
    return found


def _within(limit: float, values: Floats) -> Floats:
    """The values, NaN where they are beyond what can be meant."""
    return np.where(np.abs(values) <= limit, values, np.nan)


def _aligned(frames: Any, stamps: Any, xyz: Floats, axis: int) -> Floats:
    """One coordinate of a landmark at the common frame times, NaN where the landmark was not seen."""
    values = np.full(len(frames), np.nan)
    values[np.searchsorted(frames, stamps)] = xyz[:, axis]
    return values


def start_ns(bag: Bag) -> int:
    """Time of the LED's edge [ns], when the legs started. Raises InputError if there is none."""
    if topics.SYNC_LED.name not in bag.topics or not bag.topics[topics.SYNC_LED.name].count:
        raise InputError(f"no {topics.SYNC_LED.name} edge, so the start is not known")
    led = bag.columns(topics.SYNC_LED.name, "stamp.sec", "stamp.nanosec")
    return int(led["stamp.sec"][0]) * 1_000_000_000 + int(led["stamp.nanosec"][0])


def _last(bag: Bag, topic: str) -> float:
    """The last value of a Float64 topic; NaN if there is none."""
    if topic not in bag.topics or not bag.topics[topic].count:
        return math.nan
    return float(bag.columns(topic, "data")["data"][-1])


def _bed(bag: Bag) -> list[tuple[int, dict[str, str]]]:
    """Log time [ns] and values of each /bed/status."""
    return [
        (message.log_time_ns, {pair.key: pair.value for pair in status.values})
        for message in bag.messages([topics.BED_STATUS.name])
        for status in message.decode().status
    ]


def _phi_sd(bed: Sequence[tuple[int, dict[str, str]]]) -> float:
    """σ_φ of the last /bed/status that gives one."""
    given = [values["phi_sd"] for _, values in bed if "phi_sd" in values]
    return number_or_nan(given[-1]) if given else math.nan


def _gait(value: object) -> str:
    return str(value.get("name", "")) if isinstance(value, dict) else str(value or "")


def _status(row: Row, exit_status: str, fault: str, reason: str) -> str:
    if exit_status not in (OK, ""):
        return exit_status
    if fault:
        return fault
    missing = [name for name in ("phi", "omega_rad_s", "speed_m_s") if not math.isfinite(getattr(row, name))]
    return f"{', '.join(missing)} not measured{f': {reason}' if reason else ''}" if missing else OK


def _by_id(rows: Mapping[Path, Row]) -> dict[str, Path]:
    """The bag of each trial id: of several with one id that of this name, else the first."""
    bags: dict[str, Path] = {}
    for bag, row in rows.items():
        if row.trial_id not in bags or files.base_name(bag) == row.trial_id:
            bags[row.trial_id] = bag
    return bags


def _same_id(bag: Path, row: Row, by_id: Mapping[str, Path]) -> str:
    used = by_id[row.trial_id].name
    return f"{bag}: trial id {row.trial_id!r} is also that of {used}, which is used; move one of them away"
