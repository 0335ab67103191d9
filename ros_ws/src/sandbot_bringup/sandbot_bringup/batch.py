"""One trial of the virtual lab in process: calls the cores of the live nodes in turn, and writes the same bag."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from sandbot_bed.protocol import prepare
from sandbot_bringup.config import robot_of
from sandbot_bringup.folder import CampaignFolder, frames_kept
from sandbot_bringup.plan import Plan, PlannedTrial, to_yaml
from sandbot_bringup.provenance import trial_message, trial_metadata
from sandbot_bringup.trial_bag import TrialBag
from sandbot_clock.gait import leg_angles
from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_common.robot import Robot
from sandbot_common.yaml_text import load_yaml
from sandbot_lab.bed import LabBed
from sandbot_lab.cameras import LabCamera
from sandbot_lab.degradation import check_jitter
from sandbot_lab.live_trial import LED_ON_S
from sandbot_lab.robot import Trace, as_seen, simulate
from sandbot_lab.world import World, draw_additional, draw_world, null_world, read_world, write_world
from sandbot_tracking.calibration import Camera, cameras_from_mapping
from sandbot_tracking.offline import OfflineTracker
from sandbot_tracking.period import PeriodMeans

BED_STEP_S = 0.02
DRAIN_S = 0.05
"""Filming continues this long after the legs have stopped, as it does live."""


@dataclass(frozen=True)
class Setup:
    """What all trials of a campaign share."""

    plan: Plan
    world: World
    folder: CampaignFolder
    files: Mapping[str, str]
    """robot.yaml and cameras.yaml as text, attached to every bag."""

    @cached_property
    def robot(self) -> Robot:
        """The robot of the campaign's robot.yaml."""
        return robot_of(self.files)

    @cached_property
    def cameras(self) -> Mapping[str, object]:
        """The sections of cameras.yaml."""
        return dict(load_yaml(self.files["cameras.yaml"]))


def choose_world(folder: CampaignFolder, robot: Robot, path: Path | None, hide: int | None) -> World:
    """The world to run in: the folder's own when resuming, else the given file, a drawn one, or the null world.

    With both a file and a seed an effect is drawn in addition to those of the file.
    """
    asked = read_world(path) if path is not None else None
    if hide is not None:
        asked = draw_world(hide) if asked is None else draw_additional(asked, hide)
    if not folder.truth.exists():
        if folder.plan_file.exists():
            raise InputError(
                f"{folder.path}: has a campaign and no {folder.truth.relative_to(folder.path)}, so its trials were not "
                "run with --batch; give another --out"
            )
        return asked or null_world()
    sealed = read_world(folder.truth)
    if asked is not None and asked.walked_by(robot) != sealed.walked_by(robot):
        raise InputError(
            f"{folder.path}: its trials were run in another world than the one asked for; give another --out"
        )
    return sealed


def check_film(world: World, files: Mapping[str, str]) -> None:
    """Raises InputError if these cameras can't film as the world requires."""
    check_jitter(world.film, cameras_from_mapping(load_yaml(files["cameras.yaml"]), "cameras")["dorsal"].frame_rate_hz)


def seal(folder: CampaignFolder, world: World) -> None:
    """Write the truth to where the analysis never looks."""
    folder.truth.parent.mkdir(parents=True, exist_ok=True)
    write_world(world, folder.truth)


def run_trial(setup: Setup, trial: PlannedTrial, start_ns: int) -> Path:
    """Prepare the bed, let the robot run before both cameras, track it, and write the bag; returns its path."""
    setup.folder.check_there()
    if not setup.folder.missing([trial]):
        # A cluster worker that died had finished it, but could not report it.
        return setup.folder.bag(trial)
    plan, world = setup.plan.for_trial(trial), setup.world.walked_by(setup.robot).at(trial.occasion)
    bed = LabBed(seed=trial.seed)
    bag = TrialBag(start_ns, world.body.leg_order)
    bag.announce(trial_message(plan, trial, setup.robot, start_ns))
    prepared = prepare(plan.bed_protocol, bed, trial.phi, bed.advance, BED_STEP_S, observe=bag.bed)
    bag.legs_start(prepared.duration_s + plan.standing_s)

    t_s = plan.setpoint_times_s(trial.omega_rad_s)
    angles, rates = leg_angles(plan.clock_gait, trial.omega_rad_s, t_s, world.body.legs_per_tripod)
    trace = simulate(world, bed.phi - world.week.phi_zero, t_s, angles, rates, seed=trial.seed)
    bag.legs(topics.LEG_SETPOINTS, t_s, angles, rates, np.zeros_like(angles))
    bag.legs(topics.LEG_STATES, t_s, trace.leg_angle_rad, trace.leg_rate_rad_s, trace.leg_effort_n_m)

    cameras = cameras_from_mapping(setup.cameras, "cameras")

    def tracker() -> OfflineTracker:
        made = OfflineTracker(cameras, setup.robot)
        for t, angle in zip(t_s, trace.leg_angle_rad, strict=True):
            made.legs(float(t), angle)
        return made

    _film(setup, trial, as_seen(trace, world.week, trial.occasion), tracker, cameras, bag)
    path = setup.folder.bag(trial)
    files = {**setup.files, "campaign.yaml": to_yaml(setup.plan)}
    bag.write(path, trial_metadata(plan, trial, setup.robot, start_ns, "simulated", "ok"), files)
    return path


def _film(
    setup: Setup,
    trial: PlannedTrial,
    trace: Trace,
    new_tracker: Callable[[], OfflineTracker],
    cameras: Mapping[str, Camera],
    bag: TrialBag,
) -> None:
    """Render and track both cameras from before the legs start until after they stop; keep frames if asked."""
    body, film = setup.world.walked_by(setup.robot).body, setup.world.film
    views = {
        name: LabCamera(name, setup.cameras[name], trial.seed, body, film)  # type: ignore[arg-type]
        for name in topics.VIEWS
    }
    kept = frames_kept(setup.plan, trial)
    tracker, means = new_tracker(), PeriodMeans()
    advance = np.mean(np.unwrap(trace.leg_angle_rad, axis=0) - trace.leg_angle_rad[0], axis=1)
    rate_hz = cameras["dorsal"].frame_rate_hz
    first = -round(setup.plan.standing_s * rate_hz)
    last = int((trace.t_s[-1] + DRAIN_S) * rate_hz)
    for number in range(first, last + 1):
        t_s, come = views["dorsal"].instant_s(number), {name: view.comes(number) for name, view in views.items()}
        frames = {name: view.film(trace, t_s, 0.0 <= t_s < LED_ON_S) for name, view in views.items() if come[name]}
        if number == 0:
            # Restarted, as the live tracker at the LED's edge, so that it knows no more than a replay of the bag would.
            tracker = new_tracker()
        sample = tracker.update(t_s, frames.get("dorsal"), frames.get("lateral"))
        bag.sample(sample)
        height_m = float(sample.front_axle[2] + sample.rear_axle[2]) / 2
        turned = float(np.interp(t_s, trace.t_s, advance))
        if t_s >= 0.0 and (done := means.update(t_s, sample.com[0], height_m, turned)) is not None:
            bag.period(t_s, done)
        for name, count in come.items():
            for _ in range(count):
                bag.frame(name, t_s, frames[name], kept)
            if (count and kept != "none") or number == first:
                bag.camera(name, t_s, cameras[name])
