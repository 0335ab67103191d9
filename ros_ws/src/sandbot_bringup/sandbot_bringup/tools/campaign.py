"""campaign: run the trials of a plan, each into one bag."""

import argparse
import dataclasses
import functools
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from sandbot_bringup.config import config_folder, files_of, robot_of, shipped
from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.plan import (
    VERDICT,
    VERDICT_KEYS,
    Plan,
    PlannedTrial,
    check_bed,
    plan_of,
    read_plan,
    to_yaml,
    trials_of,
    with_next_trials,
)
from sandbot_bringup.power_analysis import detectable_effects, gaps, in_words
from sandbot_bringup.supervision import SILENCE_BOUNDS_S, SILENCE_S
from sandbot_common import cli
from sandbot_common.errors import InputError
from sandbot_common.host_clock import check_set
from sandbot_common.parameters import specs
from sandbot_common.shared_memory import check_room
from sandbot_common.terminal import counted, filled
from sandbot_common.worker_options import add_worker_options, refuse_worker_options, workers_of
from sandbot_common.yaml_text import load_yaml, parse_yaml

if TYPE_CHECKING:
    from sandbot_lab.world import World


def main(argv: Sequence[str] | None = None) -> int:
    """Console script; exit code as in sandbot_common.cli."""
    return cli.run(command, argv)


def command(argv: Sequence[str]) -> int:
    """Run, resume, extend or only describe a campaign."""
    options, ros_arguments = cli.with_ros(_parser(), argv)
    if options.config_folder:
        print(config_folder())
        return 0
    plan, folder = _plan_and_folder(options)
    files = files_of(plan, options.plan if options.plan.is_dir() else options.plan.parent, folder.path)
    trials = sorted(trials_of(plan), key=lambda trial: trial.run_order)
    if options.batch and ros_arguments:
        raise InputError("--ros-args: --batch runs without ROS; leave one of the two out")
    folder.check(plan)
    check_bed(plan, live=not options.batch)
    world = _lab(plan, folder, files, options) if options.batch else None
    for gap in in_words(lost := gaps(plan, trials, files)):
        print(f"note: {gap}; raise periods or min_duration_s")
    if options.dry_run:
        print(describe(plan, trials), filled(detectable_effects(plan, trials, files, lost)), sep="\n")
        return 0
    redo = functools.partial(_not_ok, folder) if options.redo else None
    if redo is not None:
        redo()  # reads the bags before any node waits for us; the later call, in the locked folder, reads only new ones
    with _interruptible(folder):
        if world is not None:
            trials, failures = _batch(plan, folder, files, world, options, redo)
            for reason in dict.fromkeys(failures.values()):
                print(f"{_named([trial_id for trial_id, why in failures.items() if why == reason])}: failed: {reason}")
        else:
            check_set(time.time())
            check_room()
            # Imported here, as the live runner starts ROS; batch and dry runs must not.
            from sandbot_bringup.nodes.live_node import run_live

            silence_s = SILENCE_S if options.silence is None else options.silence
            queue = run_live(plan, folder, files, redo=redo, silence_s=silence_s, ros_arguments=ros_arguments)
            # Its plan may have grown.
            trials, failures = trials_of(queue.plan), queue.failed
            if failures:  # the reasons were printed as they came
                print(filled(f"failed: {', '.join(failures)}"))
    return _finish(folder, trials, failures)


def _named(trials: Sequence[str]) -> str:
    """The trials that failed for one reason, in one line."""
    return trials[0] if len(trials) == 1 else f"{trials[0]} and {counted(len(trials) - 1, 'other trial')}"


@contextmanager
def _interruptible(folder: CampaignFolder) -> Iterator[None]:
    """Say how to go on after Ctrl-C, if there is anything to go on with."""
    try:
        yield
    except KeyboardInterrupt:
        if folder.plan_file.exists():
            batch = " --batch" if folder.truth.exists() else ""
            again, table = f"trackway campaign {folder.path}{batch}", f"trackway table {folder.path}"
            print(f"to go on: {again}; the table so far: {table}", flush=True)
        raise


def describe(plan: Plan, trials: Sequence[PlannedTrial]) -> str:
    """What the campaign would do, as text."""
    seconds = sum(plan.duration_s(trial.omega_rad_s) + plan.standing_s for trial in trials)
    frequencies = "1 frequency" if len(plan.omega_rad_s) == 1 else f"{len(plan.omega_rad_s)} frequencies"
    until = f"until a verdict, {plan.max_trials} trials at most, at first these: " if plan.until else ""
    return (
        f"campaign {plan.name}: {until}{counted(len(trials), 'trial')}, {counted(len(plan.phi), 'volume fraction')} "
        f"{min(plan.phi):g}-{max(plan.phi):g} x {frequencies} "
        f"{min(plan.omega_rad_s):g}-{max(plan.omega_rad_s):g} rad/s x {counted(plan.replicates, 'replicate')}"
        f" + {counted(len(plan.extra_trials), 'extra condition')}\n"
        f"gait {plan.gait}; legs turn for {seconds / 60:.1f} min in all, the bed is prepared {len(trials)} times\n"
        f"order {plan.order}, seed {plan.seed}:\n"
    ) + "\n".join(f"{trial.run_order:4d}  {trial.batch:8}  {trial.trial_id}" for trial in trials)


def _parser() -> argparse.ArgumentParser:
    parser = cli.Parser(prog="campaign", description=__doc__)
    parser.add_argument(
        "plan",
        type=Path,
        nargs="?",
        help="campaign.yaml, a plan of --config-folder by its name, or the folder of a campaign to resume",
    )
    parser.add_argument("--out", type=Path, help="the campaign's folder (default: next to the plan, under its name)")
    parser.add_argument("--batch", action="store_true", help="virtual lab in process, as fast as the CPU allows")
    parser.add_argument("--plan", dest="next_trials", type=Path, help="add the next_trials of this discovery JSON")
    parser.add_argument("--world", type=Path, help="the virtual lab's world.yaml (--batch; default: nothing is hidden)")
    parser.add_argument(
        "--hide",
        type=int,
        metavar="SEED",
        help="hide an effect drawn with SEED, in addition to those of --world (--batch)",
    )
    parser.add_argument(
        "--images", choices=("none", "jpeg", "video", "raw"), help="frames in every bag (default: of one trial, JPEG)"
    )
    add_worker_options(parser, "run the trials of --batch")
    parser.add_argument(
        "--redo",
        choices=("failed",),
        help="run each trial that is not ok once more; its bag is kept in trials/.partial",
    )
    _add_until(parser)
    parser.add_argument(
        "--silence",
        type=float,
        metavar="S",
        help="a node that is silent for longer ends the live trial under way (default: 1)",
    )
    parser.add_argument("--config-folder", action="store_true", help="print the folder of the example plans, and exit")
    parser.add_argument(
        "--dry-run", action="store_true", help="check the plan; say what would be done, and what could be found"
    )
    return parser


def _add_until(parser: argparse.ArgumentParser) -> None:
    """Options of a campaign that ends with a verdict: the plan's own keys, but that ``budget: 0`` is not typed."""
    parser.add_argument(
        "--until",
        choices=(VERDICT,),
        help="run only as much of the plan's grid as a verdict needs: after each block choose the next, or stop",
    )
    parser.add_argument(
        "--budget", type=int, metavar="N", help="largest number of trials (--until; default: as many as the grid has)"
    )
    usual = {field.name: field.default for field in dataclasses.fields(Plan)}
    for spec in specs(Plan):
        if spec.name in VERDICT_KEYS and spec.name != "budget":
            text = f"{spec.doc} (--until; default: {usual[spec.name]})"
            metavar = "FRACTION" if spec.name.startswith("bed_") else None
            parser.add_argument(_flag(spec.name), type=spec.type, metavar=metavar, help=text)


def _plan_and_folder(options: argparse.Namespace) -> tuple[Plan, CampaignFolder]:
    _check(options)
    beside = options.plan.parent
    options.plan = shipped(options.plan)
    resumed = options.plan.is_dir()
    plan = read_plan(options.plan / "campaign.yaml" if resumed else options.plan)
    if options.images is not None:
        plan = dataclasses.replace(plan, images=options.images)
    plan = _until(plan, options)
    path = options.out or (options.plan if resumed else beside / plan.name)
    # Absolute, because the workers of a cluster have other working directories.
    folder = CampaignFolder(path.absolute() if options.dask else path)
    plan = folder.grown(plan)
    if options.next_trials is not None:
        plan = with_next_trials(plan, options.next_trials)
    if plan.until:
        from sandbot_bringup.until import with_start

        with _options_named(options) as where:
            plan = with_start(plan, where)
    return plan, folder


def _check(options: argparse.Namespace) -> None:
    """Raises InputError for options that are out of range or would be ignored, and without a plan."""
    if options.plan is None:
        raise InputError("a plan is needed: campaign.yaml, or the folder of a campaign to resume (see campaign --help)")
    if options.budget is not None and options.budget < 1:
        raise InputError(f"--budget {options.budget}: 1 or more trials are needed; leave it out for the whole grid")
    if not options.batch:
        refuse_worker_options(options, "live trials run one by one; it is for those of --batch")
    if options.hide is not None and options.hide < 0:
        raise InputError(f"--hide: {options.hide} is not a seed; 0 or more")
    low_s, high_s = SILENCE_BOUNDS_S
    if options.silence is not None and not low_s <= options.silence <= high_s:
        raise InputError(f"--silence: {options.silence:g} is not from {low_s:g} to {high_s:g} s")
    if options.batch and options.silence is not None:
        raise InputError("--silence: --batch runs without nodes; leave one of the two out")
    if not options.batch and (options.world or options.hide is not None):
        raise InputError("--world and --hide set up the virtual lab of --batch; a live lab has its own world parameter")


def _until(plan: Plan, options: argparse.Namespace) -> Plan:
    """The plan with the command line's options on the verdict, checked as if they were in the file."""
    given = {key: getattr(options, key) for key in ("until", *VERDICT_KEYS)}
    given = {key: value for key, value in given.items() if value is not None}
    if not given:
        return plan
    if not plan.until and options.until is None:
        raise InputError(f"{_flag(next(iter(given)))} needs --until {VERDICT}")
    grown = parse_yaml(to_yaml(dataclasses.replace(plan, **given)), plan.name)
    with _options_named(options) as where:
        return plan_of(grown, where)


@contextmanager
def _options_named(options: argparse.Namespace) -> Iterator[str]:
    """What opens an InputError here: the plan's file, in place of which the option is named that set the key."""
    where = str(options.plan)
    try:
        yield where
    except InputError as error:
        key, _, said = str(error).removeprefix(f"{where}: ").partition(": ")
        if key not in VERDICT_KEYS or getattr(options, key) is None:
            raise
        raise InputError(f"{_flag(key)}: {said}") from None


def _flag(key: str) -> str:
    return f"--{key.replace('_', '-')}"


def _not_ok(folder: CampaignFolder) -> dict[str, str]:
    """The bags of the folder that are not ok or give no row, by name, with their statuses."""
    from sandbot_record.trials import from_bags as table
    from sandbot_record.trials.table import OK

    if not table.bags_in(folder.trials):
        return {}
    found = table.report_of(folder.path)
    bad = [row for row in found.trials.rows() if row.status != OK and row.trial_id in found.bags]
    lost = {bag.name: why.removeprefix(f"{bag}: ") for bag, why in found.skipped.items()}
    return lost | {found.bags[row.trial_id].name: row.status for row in bad}


def _lab(plan: Plan, folder: CampaignFolder, files: Mapping[str, str], options: argparse.Namespace) -> "World":
    """The virtual lab's world. Raises InputError if there is no valid one, or if bed or cameras don't suit it."""
    from sandbot_bringup.batch import BED_STEP_S, check_film, choose_world
    from sandbot_lab.cameras import check_cameras

    plan.bed_protocol.check_step(BED_STEP_S)
    check_cameras(load_yaml(files["cameras.yaml"]), plan.cameras or "cameras.yaml")
    world = choose_world(folder, robot_of(files), options.world and shipped(options.world), options.hide)
    check_film(world, files)
    return world


def _batch(
    plan: Plan,
    folder: CampaignFolder,
    files: Mapping[str, str],
    world: "World",
    options: argparse.Namespace,
    redo: Callable[[], Mapping[str, str]] | None,
) -> tuple[list[PlannedTrial], dict[str, str]]:
    """All trials of the final plan, and why some failed; bags of ``redo`` are moved away first."""
    from sandbot_bringup import batch, runner
    from sandbot_bringup.until import decide

    with workers_of(options) as workers, folder.adopted(plan, files, lambda: batch.seal(folder, world)):
        workers.check(folder.path)
        folder.remove_unfinished()
        folder.set_aside(redo() if redo else {})
        failed: dict[str, str] = {}
        while True:
            trials = trials_of(plan)
            todo = [trial for trial in folder.missing(trials) if trial.trial_id not in failed]
            if len(todo) < len(trials) and not plan.until:
                print(f"{folder.path}: {len(trials) - len(todo)} of {len(trials)} trials are there already")
            setup = batch.Setup(plan, world, folder, files)
            todo.sort(key=lambda trial: trial.run_order)
            outcome = runner.run(todo, functools.partial(batch.run_trial, setup), workers)
            folder.check_there()
            failed |= dict(outcome.failed)
            # A look at an incomplete set of trials would choose other trials than one at all of them.
            if not plan.until or outcome.cut_short or len(folder.missing(trials)) == len(trials):
                return trials, failed
            plan, entry = decide(plan, folder, workers=workers)
            print(filled(f"look {entry['look']}: {entry['text']}"))
            if not entry["next"]:
                return trials, failed
            folder.adopt(plan, files)


def _finish(folder: CampaignFolder, trials: Sequence[PlannedTrial], failures: Collection[str]) -> int:
    from sandbot_record.trials import from_bags as table

    finished = len(trials) - len(folder.missing(trials))
    if not finished:
        return 1
    lost = table.make(folder.path).skipped
    for line in lost.values():
        print(f"skipped: {line}")
    finished -= sum(folder.bag(trial) in lost for trial in trials)
    print(f"{folder.path}: {finished} of {len(trials)} trials, table in {folder.path / table.TRIALS_CSV}")
    return 1 if failures or lost else 0
