"""What a campaign asks for in which order, and what becomes of a bag it can't read: without a graph."""

import json
import math
import time
from dataclasses import asdict, replace
from types import SimpleNamespace

import bags
import pytest
import rclpy

from sandbot_bed.protocol import ProtocolParameters
from sandbot_bringup import folder as folders
from sandbot_bringup.endings import CampaignEnds, Held, StoppedByHand, TrialFailed
from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.hold import Hold
from sandbot_bringup.nodes import campaign_node, services_node
from sandbot_bringup.nodes.campaign_node import CampaignNode, keep_complete
from sandbot_bringup.nodes.monitor_node import NodeStatus
from sandbot_bringup.plan import Plan, trials_of
from sandbot_bringup.provenance import trial_message
from sandbot_common.robot import SANDBOT, Robot
from sandbot_common.ros.timer import end_timers
from sandbot_common.standstill import BEGUN, OLD, REFUSED_S, STOPPED, STOPPED_S
from sandbot_common.stop import Stop
from sandbot_record.bags.reader import Bag
from sandbot_record.bags.writer import add_metadata

PLAN = Plan(name="one", phi=(0.605,), omega_rad_s=(12.0,), gait="UNIFORM")
LAUNCHED = {"bed": asdict(ProtocolParameters(fluidise_s=0.7)) | {"target_phi": 0.6}, "clock": {"max_run_s": 30.0}}
(TRIAL,) = trials_of(replace(PLAN, replicates=1))


class ServiceClients:
    """Keeps what was asked; refuses what is named."""

    def __init__(self, refused=""):
        self.asked, self.refused, self.values = [], refused, {}

    def call(self, name, begun=None, since_s=None):
        self.asked.append(name)
        if name == self.refused:
            raise TrialFailed(f"{name} refused: the clock is running; call /clock/stop first")

    def set(self, node, values):
        self.asked.append((node, values.get("omega_rad_s")))
        self.values[node] = values

    def get(self, node, names):
        return {name: LAUNCHED[node][name] for name in names}

    def await_answers(self):
        self.asked.append("answers")

    def send_values(self, node, values):
        self.values[node] = values
        return type("Answer", (), {"done": lambda _: True})()


class Monitor:
    """A trackway at rest."""

    statuses = {"tracker": NodeStatus(0, "ok")}

    def forget_trial(self):
        pass


def operator(refused="", plan=PLAN):
    one = object.__new__(CampaignNode)
    one._plan, one._service_clients, one._monitor = plan, ServiceClients(refused), Monitor()
    one._bed, one._found = plan.bed_protocol, {}
    one._lease, one._commanding, one._begun_s = None, False, 0.0
    one._health = SimpleNamespace(held_up_s=0.0, refused="")
    one._preflight = type("Preflight", (), {"has_lab": False, "before_trial": lambda *_: None})()
    return one


def test_omega_is_not_set_of_legs_that_somebody_else_runs():
    one = operator(refused="/clock/home")
    with pytest.raises(TrialFailed, match="the clock is running"):
        one._set_up(TRIAL)
    assert one._service_clients.asked == ["/clock/home"]


def test_omega_is_set_of_legs_at_rest_and_again_before_they_start():
    one = operator(refused="/clock/start")
    one._set_up(TRIAL)
    assert one._service_clients.asked[:2] == ["/clock/home", ("clock", 12.0)]
    one._service_clients.asked.clear()
    with pytest.raises(TrialFailed):
        one._walk(TRIAL)
    assert one._service_clients.asked == ["/clock/home", ("clock", 12.0), "/clock/start"]


@pytest.mark.parametrize(("reports", "said"), [(True, "no leg moved"), (False, "whether a leg moved is not known")])
def test_of_legs_that_are_not_heard_nothing_is_said(reports, said):
    one = operator()
    one._wait = lambda *_: False
    silent = {"motion_start_ns": None, "robot_warns": ""}
    one._monitor = SimpleNamespace(statuses=Monitor.statuses, reports_legs=reports, **silent)
    with pytest.raises(TrialFailed, match=f"the clock was started but {said}"):
        one._walk(TRIAL)


def test_a_robot_that_warns_and_does_not_move_is_left_to_a_person():
    one = operator()
    one._wait, one._spin_until = lambda *_: False, lambda *_: False
    one.hold, one.interface = Hold(), SimpleNamespace(attended=True)
    silent = {"motion_start_ns": None, "robot_warns": "rig: emergency stop"}
    one._monitor = SimpleNamespace(statuses=Monitor.statuses, reports_legs=True, **silent)
    with pytest.raises(Held, match=r"the robot does not move as it is told \(rig: emergency stop\)"):
        one._walk(TRIAL)


def heard_of_bed(preparation, stage, text=""):
    """Legs that report rest, and a bed's last message."""
    bed = {"bed_preparation": preparation, "bed_stage": stage, "bed_text": text, "robot_warns": ""}
    return SimpleNamespace(statuses=Monitor.statuses, motion_start_ns=None, reports_legs=True, **bed)


def test_what_begins_is_told_by_legs_and_bed_themselves():
    """Whoever has not got the answer asks again only for what has not begun."""
    one, begun = operator(), {}
    one.interface, one._stopped_by_hand = SimpleNamespace(enter=lambda _: None), lambda _: None
    one._service_clients.call = lambda name, word=None, *_: begun.update({name: word})
    one._wait = lambda *_: False
    one._monitor = heard_of_bed("3", "ready")
    for part in (one._prepare_bed, lambda: one._walk(TRIAL)):
        with pytest.raises(TrialFailed):
            part()
    asked = ("/bed/prepare", "/clock/start")
    assert not any(begun[name]() for name in asked)
    one._monitor.bed_preparation, one._monitor.motion_start_ns = "4", 1
    assert all(begun[name]() for name in asked)


@pytest.mark.parametrize(
    ("number", "stage", "prepared"),
    [("4", "ready", True), ("3", "ready", False), ("4", "settle", False), ("4", "failed", False)],
)
def test_only_a_bed_that_is_ready_with_the_preparation_that_was_asked_for_is_prepared(number, stage, prepared):
    one = operator()
    one.interface = SimpleNamespace(enter=lambda _: None)
    one._monitor = SimpleNamespace(bed_preparation="3", bed_stage="ready", bed_text="")
    one._service_clients.call = lambda *_: vars(one._monitor).update(bed_preparation=number, bed_stage=stage)
    one._wait = lambda condition, _: condition()
    if prepared:
        one._prepare_bed()
        return
    with pytest.raises(TrialFailed, match="the bed was not prepared"):
        one._prepare_bed()


def test_legs_and_air_may_begin_only_while_the_campaign_asks_for_them():
    """A request does not name its sender: clock and bed go by the lease."""
    one, said, asked = operator(), [], {}
    one.interface, one._allowed, one._commanding = SimpleNamespace(enter=lambda _: None), "nothing", True
    one.get_clock = lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=1))
    one.get_name = lambda: "campaign"
    one._lease = SimpleNamespace(publish=lambda message: said.append(message.frame_id), wait_for_all_acked=lambda _: 1)
    one._wait = lambda condition, _: condition()
    one._monitor = heard_of_bed("", "failed", "no height")
    one._service_clients.call = lambda name, *_: asked.update({name: said[-1:]})
    with pytest.raises(TrialFailed):
        one._walk(TRIAL)
    with pytest.raises(TrialFailed, match="no height"):
        one._prepare_bed()
    assert asked == {"/clock/home": [], "/clock/start": ["campaign legs"], "/bed/prepare": ["campaign air"]}
    one._renewed_s = 0.0
    one._renew(1.0)
    assert said[-1] == "campaign nothing"


def asked(said, since_s):
    """How long /clock/start is waited for that answers ``said`` one after the other; of a trial begun at 100 s."""
    one, waited = object.__new__(services_node.ServiceClients), []
    answers = iter([SimpleNamespace(success=message == "running", message=message) for message in said])
    one._triggers, one._ask = {"/clock/start": None}, lambda *_: next(answers)
    one._wait = lambda _, seconds: waited.append(seconds)
    one.call("/clock/start", since_s=since_s)
    return waited


@pytest.mark.parametrize("why", [OLD, BEGUN])
def test_who_was_held_up_until_just_now_is_asked_again(why):
    assert asked([why, "running"], time.monotonic()) == [REFUSED_S[why]]


def test_who_was_held_up_and_then_stopped_before_the_trial_is_asked_until_both_are_over():
    """A bed that was frozen in the last trial, whose stop it has just obeyed."""
    waited = asked([STOPPED, OLD, "running"], time.monotonic() - 2.0)
    assert waited == [pytest.approx(STOPPED_S - 2.0, abs=0.9), REFUSED_S[OLD]]
    with pytest.raises(TrialFailed, match="held up until just now"):
        asked([OLD, OLD], time.monotonic())
    with pytest.raises(StoppedByHand):
        asked([OLD, STOPPED, STOPPED], time.monotonic() - 60.0)


def test_a_stop_before_the_trial_is_waited_for_and_a_later_one_holds():
    """The end of the last trial, or a person before Go, are no reason to end this one."""
    (waited_s,) = asked([STOPPED, "running"], time.monotonic() - 2.0)
    assert waited_s == pytest.approx(STOPPED_S - 2.0, abs=0.9)
    with pytest.raises(StoppedByHand, match="stopped by hand before /clock/start"):
        asked([STOPPED, STOPPED], time.monotonic() - 60.0)


def test_legs_that_were_stopped_by_hand_before_they_began_hold_the_campaign():
    one = operator()
    one.hold, one._allowed, one._commanding, one._lease = Hold(), "nothing", False, None
    one.interface, one._spin_until = SimpleNamespace(attended=True), lambda *_: False

    def stopped(*_):
        raise StoppedByHand("stopped by hand before /clock/start")

    one._service_clients.call = stopped
    with pytest.raises(Held, match="stopped by hand before /clock/start"):
        one._start("legs", "/clock/start", lambda: False)
    assert one.hold.state == "stopping"
    one.hold, one.interface.attended = Hold(), False
    with pytest.raises(CampaignEnds):
        one._start("legs", "/clock/start", lambda: False)


@pytest.mark.parametrize("held_s", [0.0, 41.0])
def test_a_campaign_that_was_suspended_commands_nothing_when_it_wakes(held_s):
    """Another may have taken over: its legs were stopped, and its settings overwritten."""
    one, sent, renewed = operator(), [], []
    one._read_settings()
    one._service_clients.send, one._spin_until, one._recorder = sent.append, lambda *_: True, object()
    one._commanding, one._renewed_s, one._allowed = True, -math.inf, "legs"
    one._lease = SimpleNamespace(publish=renewed.append)
    one.get_name = lambda: "campaign"
    one.get_clock = lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=1))
    one._health = SimpleNamespace(held_up_s=held_s, refused="taken over" * bool(held_s))
    one._monitor.fault = lambda: ""
    one._recorder = SimpleNamespace(ended=False, frozen=False)
    one._renew(1.0)
    assert one._fault() == ("the campaign was held up for 41 s" if held_s else "")
    one._make_safe()
    one.restore_settings()
    assert bool(renewed) is bool(sent) is bool(one._service_clients.values) is (not held_s)


@pytest.mark.parametrize("refused", ["another campaign is running already", ""])
def test_a_second_campaign_ends_before_it_offers_a_lease_or_makes_a_folder(monkeypatch, refused):
    """Its nodes had been heard, the other campaign had not: it made a folder, and was refused at its first trial."""
    monkeypatch.setattr(campaign_node, "publisher", lambda *_: "lease")
    one = operator()
    one._preflight, one._recorder, one.hold = SimpleNamespace(find_nodes=lambda: None), None, Hold()
    one._stop, one._health = SimpleNamespace(asked=False), SimpleNamespace(settled=False, refused="")

    def spin(condition, _):
        assert not condition()
        vars(one._health).update(settled=not refused, refused=refused)
        return condition()

    one._spin_until = spin
    if refused:
        with pytest.raises(CampaignEnds, match=refused):
            one.find_nodes()
    else:
        one.find_nodes()
    assert one._lease == (None if refused else "lease")


@pytest.mark.ros
def test_a_stop_is_heard_from_the_first_moment_and_holds_what_has_not_begun(domain):
    rclpy.init()
    one = CampaignNode(PLAN, SANDBOT, Stop())
    try:
        assert {"campaign/stop", "campaign/pause", "campaign/go"} <= {service.srv_name for service in one.services}
        one.hold.stop("stopped by the operator")
        assert one._wait(lambda: True, 1.0)  # as it looks for its nodes
        one._lease = object()  # all are there
        with pytest.raises(Held):
            one._wait(lambda: True, 1.0)
    finally:
        end_timers(one)
        rclpy.try_shutdown()


def test_what_a_plan_says_of_the_bed_holds_for_its_own_campaign_alone():
    one = operator(plan=replace(PLAN, bed={"settle_s": 0.4, "average_s": 0.2}))
    one._read_settings()
    one._set_up(TRIAL)
    set_up = LAUNCHED["bed"] | {"settle_s": 0.4, "average_s": 0.2, "target_phi": 0.605}
    assert one._service_clients.values["bed"] == set_up
    one._service_clients.values["bed"]["settle_s"] = 9.0
    one._read_settings()  # the next trial's: what is launched is what was there before the first
    one.restore_settings()
    assert one._service_clients.values["bed"] == LAUNCHED["bed"]
    assert one._service_clients.values["clock"] == {"max_run_s": 30.0}
    told = json.loads(trial_message(one._plan, TRIAL, Robot(), 0, one._bed))
    assert told["bed"] == {name: set_up[name] for name in set_up if name != "target_phi"}


def test_a_trial_begins_when_the_stops_of_the_last_one_have_been_obeyed(tmp_path):
    """A bed that was frozen obeys them seconds after it resumes, and would abort what this trial prepares."""
    one, folder, began = operator(), CampaignFolder(tmp_path / "live"), {}
    folder.path.mkdir()
    one._begun_s, one._wait, one._running = math.nan, lambda *_: True, ""
    one._preflight.before_trial = lambda *_: one._service_clients.asked.append("preflight")
    one._service_clients.await_answers = lambda: (
        one._service_clients.asked.append("answers") or began.update(s=one._begun_s)
    )

    def set_up(_):
        raise TrialFailed("far enough")

    one._set_up = set_up
    with pytest.raises(TrialFailed, match="far enough"):
        one.run(TRIAL, folder, [])
    assert one._service_clients.asked == ["preflight", "answers"]  # a frozen bed doesn't pass the preflight
    assert math.isnan(began["s"])
    assert math.isfinite(one._begun_s)


@pytest.mark.parametrize("why", ["killed by SIGKILL", "recorded 9 messages; stopped: No space left on device: /bag"])
def test_of_a_recorder_that_could_not_close_its_bag_the_reason_is_said(tmp_path, why):
    one, folder = operator(), CampaignFolder(tmp_path / "live")
    folder.path.mkdir()
    one._set_up, one._wait = lambda _: None, lambda *_: True
    one._run = lambda *_: SimpleNamespace(code=1, why_ended=why)
    with pytest.raises(TrialFailed) as failed:
        one.run(TRIAL, folder, [])
    assert str(failed.value) == f"the recorder ended: {why}; its bag is {folder.partial(TRIAL.trial_id)}"


@pytest.mark.parametrize(
    ("looks", "asked", "stages", "killed"),
    [
        (["closed"], False, 0, False),
        (["busy"], False, 0, True),
        (["blocked", "blocked", "closed"], False, 2, False),
        (["blocked", "busy"], False, 1, True),
        (["blocked"], True, 0, False),  # Ctrl-C: it closes its bag once the disk answers
    ],
)
def test_a_recorder_is_not_killed_for_a_disk_that_does_not_answer(looks, asked, stages, killed):
    one, seen, entered, kills = operator(), iter(looks), [], []

    def spin(condition, _):
        vars(recorder).update(ended=(now := next(seen)) == "closed", awaits_disk=now == "blocked")
        return condition()

    recorder = SimpleNamespace(ended=False, awaits_disk=False, tell=lambda _: None, kill=kills.append)
    one._spin_until, one.interface = spin, SimpleNamespace(enter=entered.append)
    one._stop = SimpleNamespace(asked=asked)
    one._end_recording(recorder, "ok")
    assert entered == ["closing the bag: its disk does not answer"] * stages
    assert kills == ["its bag was not closed within 30 s"] * killed
    assert next(seen, None) is None


def test_a_bag_that_is_still_open_when_the_campaign_ends_is_no_finished_trial(tmp_path):
    one, folder = operator(), CampaignFolder(tmp_path / "live")
    folder.path.mkdir()
    one._set_up, one._wait = lambda _: None, lambda *_: True
    one._run = lambda *_: SimpleNamespace(code=None)
    with pytest.raises(TrialFailed, match="its disk does not answer; the recorder is left to close "):
        one.run(TRIAL, folder, [])


def run(tmp_path, damage):
    """A trial of which only the bag is real, damaged as told."""
    one, folder = operator(), CampaignFolder(tmp_path / "live")
    folder.path.mkdir()

    def record(_trial, aside, _attachments):
        damage(bags.trial_bag(aside))
        return type("Recorder", (), {"code": 0})()

    one._set_up, one._run, one._wait = lambda _: None, record, lambda *_: True
    return one.run(TRIAL, folder, []), folder


def test_a_bag_that_can_be_read_gives_its_row_and_its_place(tmp_path, monkeypatch):
    synced = []
    monkeypatch.setattr(folders, "sync", lambda path: synced.append([one.name for one in path.glob("[!.]*")]))
    row, folder = run(tmp_path, lambda bag: None)
    assert synced == [[TRIAL.trial_id]]  # no power cut takes its name from it
    assert row.status == "ok"
    assert Bag.open(folder.bag(TRIAL)).count


def cut(bag):
    """Leave the head of its file, as a disk does that lost the rest."""
    (file,) = bag.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:40])
    (bag / "metadata.yaml").write_text("not: [a bag")


@pytest.mark.parametrize("damage", [cut, lambda bag: [file.unlink() for file in bag.iterdir()]])
def test_a_bag_that_cannot_be_read_fails_its_trial_and_not_the_campaign(tmp_path, damage):
    with pytest.raises(TrialFailed, match=r"unreadable: .*; its bag is kept in ") as failed:
        run(tmp_path, damage)
    folder = CampaignFolder(tmp_path / "live")
    (aside,) = (folder.trials / ".partial").iterdir()
    assert str(failed.value).endswith(f"kept in {aside}")
    assert not folder.bag(TRIAL).exists()


@pytest.mark.parametrize(
    ("ended", "recorded", "change", "damage", "kept"),
    [
        ("ok", "ok", {}, lambda _: None, True),
        ("whoever ran the trial is gone", "ok", {}, lambda _: None, False),
        ("ok", "incomplete, not recorded: /com", {}, lambda _: None, False),
        ("ok", "ok", {"seed": TRIAL.seed + 1}, lambda _: None, False),
        ("ok", "ok", {"trial_id": "another"}, lambda _: None, False),
        ("ok", "ok", {"omega_rad_s": None}, lambda _: None, False),  # it would give no row
        ("ok", "ok", {}, cut, False),
    ],
)
def test_a_complete_trial_of_a_killed_campaign_is_kept(tmp_path, capsys, ended, recorded, change, damage, kept):
    folder = CampaignFolder(tmp_path)
    told = bags.PLAN | {"trial_id": TRIAL.trial_id, "seed": TRIAL.seed}
    bag = bags.trial_bag(folder.partial_bag(TRIAL.trial_id), plan=told | change, exit_status=ended)
    add_metadata(bag, "recording", {"exit_status": recorded})
    damage(bag)
    keep_complete(folder, [TRIAL])
    assert (folder.missing([TRIAL]) == []) is kept
    assert bag.exists() is not kept
    assert capsys.readouterr().out == f"{TRIAL.trial_id}: was complete when the campaign was killed: kept\n" * kept
    keep_complete(folder, [TRIAL])  # once more: nothing changes
    assert (folder.missing([TRIAL]) == []) is kept
