"""Clock, bed and lab as real processes: without a lease, a robot or a command in time, all stops by itself.

Bounds are read on the stamps of the nodes' own messages. For how long a busy machine kept the two processes waiting is
not the code's, and is added to each.
"""

import contextlib
import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from processes import running
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import LivelinessPolicy, QoSProfile
from starved import Starved

from sandbot_common import health, messages, topics
from sandbot_common.ros import endpoints

pytestmark = [pytest.mark.ros, pytest.mark.timeout(120)]

OMEGA, RATE_HZ = 16.0, 200.0
FASTEST_RAD = 10 * 1.5 * OMEGA / RATE_HZ
"""The fast phase of SGCS, one and a half times its mean rate, turns no leg further than this in ten periods."""
LEGS_S, AIR_S = 0.4, 0.7
"""The leases, and what a machine with nothing else to do may add."""
BUSY_S = 5.0
"""What any machine may add to a process that has ended since."""
ASK = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))"
HURRIED = os.SCHED_OTHER if subprocess.call([sys.executable, "-c", ASK], stderr=subprocess.DEVNULL) else os.SCHED_FIFO
"""How a node runs that asks for real-time priority: as any other where this host grants none."""


def busy_beside(process):
    """For how long the machine keeps a process or this one waiting since now."""
    return Starved(process.pid, os.getpid())


def ended(process, number):
    """What a node said after the signal, and its exit code."""
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    return said.splitlines(), process.returncode


class Commander:
    """Renews the lease and reports legs, as a campaign and a robot do, until told to fall silent."""

    def __init__(self, beside):
        self.beside, self.setpoints, self.states, self.told = beside, [], [], {}
        self.renewing, self.reporting = False, False
        self.renewed_ns = self.reported_ns = 0
        self._lease = self._legs = None
        endpoints.subscription(beside.node, topics.LEG_SETPOINTS, self._on_setpoint)
        endpoints.subscription(beside.node, topics.DIAGNOSTICS, self._on_diagnostics)
        beside.node.create_timer(0.02, self._tick)

    def command(self):
        """Be whoever commands from now on."""
        self._lease = endpoints.publisher(self.beside.node, topics.OPERATOR_LEASE)
        self.renewing = True
        self.beside.until(self._lease.get_subscription_count)

    def be_the_robot(self):
        """Report legs from now on."""
        self._legs = endpoints.publisher(self.beside.node, topics.LEG_STATES)
        self.reporting = True
        self.beside.until(self._legs.get_subscription_count)

    def _tick(self):
        zero = np.zeros(6)
        if self._lease is not None and self.renewing:
            self.renewed_ns = time.time_ns()
            self._lease.publish(messages.header(self.renewed_ns, "beside"))
        if self._legs is not None and self.reporting:
            self.reported_ns = time.time_ns()
            self._legs.publish(messages.joint_state(self.reported_ns, topics.LEGS, zero, zero, zero))

    def _on_setpoint(self, message):
        self.setpoints.append(message)

    def _on_diagnostics(self, message):
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self.told[status.name] = (status.level[0], status.message, values)

    def walk(self):
        """Start the clock, again where a busy machine held one of us up, until legs move for longer than any lease."""

        def walks():
            self.beside.until(lambda: self.beside.call("/clock/start").success)
            self.setpoints.clear()
            return self.beside.wait(lambda: len(self.setpoints) > 0.4 * RATE_HZ, 5.0) and self.moving

        self.beside.until(walks)

    @property
    def moving(self):
        return any(self.setpoints[-1].velocity)

    def stopped(self, why):
        """When the legs came to rest [ns], once the clock has said why."""
        self.beside.until(lambda: not self.moving)
        self.beside.until(lambda: why in self.told["clock"][1])
        assert self.told["clock"][0] == 2
        angles = np.array([message.position for message in self.setpoints])
        assert np.abs(np.diff(angles, axis=0)).max() <= FASTEST_RAD  # no jump, whatever happened
        return messages.nanoseconds(self.setpoints[-1].header.stamp)


@pytest.fixture
def commander(beside):
    return Commander(beside)


class StandIn:
    """A process that /diagnostics tells to be some node's, in whose name somebody else goes on commanding."""

    def __init__(self, beside, name):
        program = "from sandbot_common.process import own_name; print(own_name(), flush=True); input()"
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        self.process = subprocess.Popen([sys.executable, "-c", program], text=True, **pipes)
        told = {health.PROCESS: self.process.stdout.readline().strip()}
        outlet = endpoints.publisher(beside.node, topics.DIAGNOSTICS)
        beside.node.create_timer(0.1, lambda: outlet.publish(messages.diagnostics(time.time_ns(), name, told)))
        beside.until(outlet.get_subscription_count)
        beside.wait(lambda: False, 0.5)  # until everybody has heard

    def close(self):
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def stand_in(beside):
    running = []

    def make(name):
        running.append(StandIn(beside, name))
        return running[-1].process

    yield make
    for one in running:
        one.close()


def test_the_clock_stops_by_itself_and_says_why(commander, beside):
    with running("sandbot_clock.nodes.clock_node", f"omega_rad_s:={OMEGA}") as clock:
        # By hand: nobody holds the lease, no robot is there; the run has an end all the same.
        answer = beside.call("/clock/start")
        assert "30 s at most" in answer.message
        assert beside.call("/clock/stop").success

        commander.command()
        commander.be_the_robot()
        commander.walk()
        busy = busy_beside(clock)
        commander.renewing = False
        rest_ns = commander.stopped("beside did not renew /operator/lease")
        assert (rest_ns - commander.renewed_ns) * 1e-9 <= LEGS_S + busy.seconds
        refused = beside.call("/clock/start")
        assert not refused.success
        assert "does not renew" in refused.message

        commander.renewing = True
        commander.walk()  # nothing resumed by itself, and a new start is one
        busy = busy_beside(clock)
        commander.reporting = False
        rest_ns = commander.stopped("robot was silent")
        assert (rest_ns - commander.reported_ns) * 1e-9 <= LEGS_S + busy.seconds

        commander.reporting = True
        commander.walk()
        clock.send_signal(signal.SIGSTOP)
        beside.wait(lambda: False, 0.4)
        clock.send_signal(signal.SIGCONT)
        commander.stopped("held up")


@pytest.mark.parametrize(("number", "why"), [(signal.SIGKILL, "gone"), (signal.SIGSTOP, "frozen")])
def test_whose_commander_is_gone_stops_though_the_lease_be_renewed(number, why, commander, beside, stand_in):
    with running("sandbot_clock.nodes.clock_node", f"omega_rad_s:={OMEGA}"):
        commander.command()
        holder = stand_in("beside")  # as the lease names its holder
        commander.walk()
        beside.wait(lambda: False, 0.5)
        assert commander.moving
        holder.send_signal(number)
        commander.stopped(f"the beside is {why}")


def test_a_lease_is_renewed_by_its_owner_alone(commander, beside):
    with running("sandbot_clock.nodes.clock_node", f"omega_rad_s:={OMEGA}") as clock:
        commander.command()
        commander.walk()
        another = endpoints.publisher(beside.node, topics.OPERATOR_LEASE)
        beside.until(another.get_subscription_count)
        renewal = messages.header(time.time_ns(), "another")
        beside.node.create_timer(0.02, lambda: another.publish(renewal))
        beside.wait(lambda: not commander.moving, 0.6)
        assert commander.moving  # whoever else renews takes nothing from its owner, either
        busy = busy_beside(clock)
        commander.renewing = False
        rest_ns = commander.stopped("beside did not renew /operator/lease")
        assert (rest_ns - commander.renewed_ns) * 1e-9 <= LEGS_S + busy.seconds
        commander.walk()  # a new start is a new lease: of the one who renews


HOLDER = """
import sys
import rclpy
from sandbot_common import messages, topics
from sandbot_common.ros import endpoints, ros_health

rclpy.init()
one = rclpy.create_node(sys.argv[1])
ros_health.Health(one, dict)
lease = endpoints.publisher(one, topics.OPERATOR_LEASE)
one.create_timer(0.02, lambda: lease.publish(messages.header(one.get_clock().now().nanoseconds, one.get_name())))
rclpy.spin(one)
"""


@contextlib.contextmanager
def holding(name):
    """A process that renews the lease under this name, until it is killed."""
    process = subprocess.Popen([sys.executable, "-c", HOLDER, name])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def test_who_resumes_at_once_after_a_kill_is_not_refused_for_the_dead_one(beside):
    heard, told = [], []
    endpoints.subscription(beside.node, topics.OPERATOR_LEASE, heard.append)
    endpoints.subscription(beside.node, topics.DIAGNOSTICS, lambda message: told.append(message.status[0].name))

    def appear(name):
        heard.clear()
        told.clear()
        beside.until(lambda: name in told and any(one.frame_id == name for one in heard))

    with running("sandbot_clock.nodes.clock_node", "lease_s:=1.0", "late_s:=0.25"):
        with holding("campaign") as first:
            appear("campaign")
            beside.until(lambda: beside.call("/clock/start").success)  # once the clock has heard of him as well
            first.kill()
            first.wait()
        with holding("campaign"):
            appear("campaign")
            assert beside.call("/clock/stop").success
            said = []

            def begun():
                said.append(beside.call("/clock/start"))
                return said[-1].success

            assert beside.wait(begun, 15.0), [one.message for one in said]
            assert beside.node.count_publishers(topics.OPERATOR_LEASE.name) == 2  # DDS has not forgotten the first one
            assert beside.call("/clock/stop").success
            with holding("another"):  # who lives is another matter
                appear("another")

                def refused():
                    assert beside.call("/clock/stop").success
                    return "another and campaign both command" in beside.call("/clock/start").message

                beside.until(refused)  # once the clock has heard of him


def test_a_run_by_hand_ends_by_itself(commander, beside):
    with running("sandbot_clock.nodes.clock_node", "max_run_s:=1.0") as clock:
        busy = busy_beside(clock)
        commander.walk()
        rest_ns = commander.stopped("max_run_s")
        walked_s = (rest_ns - messages.nanoseconds(commander.setpoints[0].header.stamp)) * 1e-9
        assert 0.3 < walked_s < 1.2 + busy.seconds


HELD_UP = """
import sys, time
from sandbot_clock.nodes import clock_node

class Clock(clock_node.ClockNode):
    def __init__(self):
        super().__init__()
        publish, self.sent = self._setpoints.publish, 0

        def late(message):
            self.sent += 1
            if self.sent % 200 == 150:
                time.sleep(0.4)
            publish(message)

        class Outlet:
            publish = staticmethod(late)

        self._setpoints = Outlet()

clock_node.ClockNode = Clock
sys.exit(clock_node.main(["--ros-args", "-p", "late_s:=0.25"]))
"""


def test_a_clock_that_is_held_up_while_it_sends_stops(commander):
    """The instant it keeps next is not late then; those between were skipped."""
    process = subprocess.Popen([sys.executable, "-c", HELD_UP])
    try:
        commander.beside.until(lambda: commander.beside.call("/clock/start").success)
        commander.stopped("held up")
    finally:
        process.terminate()
        process.wait(60)


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGTERM, signal.SIGINT])
def test_a_clock_that_ends_leaves_the_legs_at_rest(number, commander):
    with running("sandbot_clock.nodes.clock_node", f"omega_rad_s:={OMEGA}", "late_s:=0.25") as clock:
        commander.walk()
        sent_ns = time.time_ns()
        said, code = ended(clock, number)
        commander.beside.until(lambda: not commander.moving)
        assert (messages.nanoseconds(commander.setpoints[-1].header.stamp) - sent_ns) * 1e-9 <= BUSY_S
        assert (said[-1], code) == (f"clock: ended: {number.name}", 0)
        assert not any("Traceback" in line for line in said)


@pytest.mark.parametrize("module", ["sandbot_tracking.tracker_parameters", "sandbot_hardware.nodes.serial_legs_node"])
def test_whose_figures_tell_his_health_says_that_he_ends_all_the_same(module, beside):
    told = []
    endpoints.subscription(beside.node, topics.DIAGNOSTICS, lambda message: told.append(message.status[0]))
    with running(module) as process:
        beside.until(lambda: told)
        process.terminate()
        beside.until(lambda: (told[-1].level, told[-1].message) == (b"\2", "ended: SIGTERM"))


def test_one_clock_at_a_time(commander, beside):
    with running("sandbot_clock.nodes.clock_node") as clock:
        beside.until(lambda: "clock" in commander.told)
        with running("sandbot_clock.nodes.clock_node") as second:
            _, said = second.communicate(timeout=60)
            assert second.returncode == 2
            assert said.count("\n") == 1
            assert "another clock is running already" in said
        assert clock.poll() is None
        # A publisher that is no node of ours is seen at the start.
        replay = endpoints.publisher(beside.node, topics.LEG_SETPOINTS)
        beside.until(lambda: beside.node.count_publishers(topics.LEG_SETPOINTS.name) == 2)
        beside.until(lambda: not beside.call("/clock/start").success)
        assert "beside and clock both publish" in beside.call("/clock/start").message
        beside.node.destroy_publisher(replay)
        clock.kill()
        # A killed clock is still in the graph for a while, but says nothing any more: the next one stays.
        commander.told.clear()
        with running("sandbot_clock.nodes.clock_node") as third:
            beside.until(lambda: "clock" in commander.told)
            beside.wait(lambda: third.poll() is not None, 1.5)
            assert third.poll() is None


class Driver:
    """Legs of another maker, which ask DDS for set-points at least that often."""

    def __init__(self, beside, deadline_s):
        self.heard, self.missed, self.alive, self.refused = [], [], [], []
        asked = Duration(seconds=deadline_s)
        beside.node.create_subscription(
            messages.message_class(topics.LEG_SETPOINTS.type),
            topics.LEG_SETPOINTS.relative,
            self.heard.append,
            QoSProfile(
                depth=10, deadline=asked, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC, liveliness_lease_duration=asked
            ),
            event_callbacks=SubscriptionEventCallbacks(
                deadline=self.missed.append,
                liveliness=lambda event: self.alive.append(event.alive_count),
                incompatible_qos=self.refused.append,
            ),
        )


def test_dds_tells_a_driver_that_asks_when_set_points_stay_away(beside, commander):
    patient, hasty = Driver(beside, topics.LEG_SETPOINTS.deadline_s), Driver(beside, 0.1)
    with running("sandbot_clock.nodes.clock_node", f"omega_rad_s:={OMEGA}", "lease_s:=1.0") as clock:
        commander.command()
        commander.walk()
        beside.until(lambda: patient.heard and patient.alive[-1:] == [1])
        patient.missed.clear()
        clock.send_signal(signal.SIGSTOP)
        beside.until(lambda: patient.missed and patient.alive[-1] == 0)
    # More often than is promised nobody may ask.
    assert hasty.refused
    assert not hasty.heard


ENGAGED = """
import sys, time
from rclpy.node import Node
from sandbot_common import topics
from sandbot_common.ros import endpoints, ros_health, node

class Engaged(Node):
    def __init__(self):
        super().__init__("engaged")
        ros_health.Health(self, dict)
        endpoints.subscription(self, topics.TRIAL, self.work)

    def work(self, _):
        print("working", flush=True)
        time.sleep(3600.0)

sys.exit(node.run(Engaged))
"""


def test_a_node_that_is_to_end_says_so_in_the_middle_of_its_work(beside):
    told = []
    endpoints.subscription(
        beside.node, topics.DIAGNOSTICS, lambda message: told.extend((one.name, one.message) for one in message.status)
    )
    process = subprocess.Popen([sys.executable, "-c", ENGAGED], stdout=subprocess.PIPE, text=True)
    try:
        beside.until(lambda: ("engaged", "ok") in told)
        endpoints.publisher(beside.node, topics.TRIAL).publish(messages.string("work"))
        assert "working\n" in process.stdout  # read up to there: DDS may have said something before
        process.send_signal(signal.SIGTERM)
        beside.until(lambda: ("engaged", "ended: SIGTERM") in told)
        assert process.poll() is None
    finally:
        process.kill()
        process.communicate()


def test_the_lab_stops_for_who_sends_nothing_that_can_be_meant(beside):
    """His clock is ahead of the lab's, too: at the stop, time must rise all the same."""
    states, told, ahead_ns, begun = [], [], 5 * 10**9, time.time_ns()
    setpoints = endpoints.publisher(beside.node, topics.LEG_SETPOINTS)
    blower = endpoints.publisher(beside.node, topics.BED_BLOWER)
    endpoints.subscription(beside.node, topics.LEG_STATES, states.append)
    endpoints.subscription(beside.node, topics.DIAGNOSTICS, lambda message: told.append(message.status[0]))
    rate, level, blown = [OMEGA], [1.0], []

    def send(rate):
        now = time.time_ns()
        angle = np.full(6, (now - begun) * 1e-9 * OMEGA)
        setpoints.publish(messages.joint_state(now + ahead_ns, topics.LEGS, angle, np.full(6, rate), np.zeros(6)))

    def command():
        if not (states and any(states[-1].velocity)) and np.isfinite(rate[0]):
            send(0.0)  # first of all; and a busy machine has sent these late, and nothing goes on by itself
        send(rate[0])

    def blow():
        blown.append(level[0])
        blower.publish(messages.float64(level[0]))

    def blows(level):
        return any(value.key == "blower" and value.value == level for value in told[-1].values)

    with running("sandbot_lab.nodes.lab_node", "images:=false") as lab:
        beside.until(lambda: setpoints.get_subscription_count() and blower.get_subscription_count() and told, 60.0)
        walking = beside.node.create_timer(0.02, command)
        beside.until(lambda: len(states) > 30 and any(states[-1].velocity))
        for nonsense in (math.nan, 1e9):
            rate[0] = nonsense
            beside.until(lambda: not any(states[-1].velocity))
            rate[0] = OMEGA
            beside.until(lambda: any(states[-1].velocity))
        walking.cancel()
        blowing = beside.node.create_timer(0.02, blow)
        beside.until(lambda: blows("1.0"))
        level[0] = math.nan
        beside.until(lambda: any("air off: blower: nan is outside" in status.message for status in told))
        for then in (math.nan, 1.0):  # nothing goes on by itself, and more of the same ends no lapse
            level[0], before = then, len(blown)
            beside.until(lambda before=before: len(blown) > before + 25)
        heard = len(told)
        beside.until(lambda: len(told) > heard + 1)
        assert blows("0.0")
        blowing.cancel()
        assert lab.poll() is None


def test_the_lab_stops_legs_and_air_whose_commands_are_late(beside):
    states, told = [], []
    setpoints = endpoints.publisher(beside.node, topics.LEG_SETPOINTS)
    blower = endpoints.publisher(beside.node, topics.BED_BLOWER)
    endpoints.subscription(beside.node, topics.LEG_STATES, states.append)
    endpoints.subscription(beside.node, topics.DIAGNOSTICS, lambda message: told.append(message.status[0]))
    start_ns = time.time_ns()
    sent = []

    def send(rate=OMEGA):
        sent.append(time.time_ns())
        angle = np.full(6, (sent[-1] - start_ns) * 1e-9 * OMEGA)
        setpoints.publish(messages.joint_state(sent[-1], topics.LEGS, angle, np.full(6, rate), np.zeros(6)))

    def said(text):
        return any(text in status.message for status in told)

    def walk():
        if not (states and any(states[-1].velocity)):
            send(0.0)  # first of all; and a busy machine has sent these late, and nothing goes on by itself
        send()

    with running("sandbot_lab.nodes.lab_node", "images:=false") as lab:
        beside.until(lambda: setpoints.get_subscription_count() and blower.get_subscription_count() and told, 60.0)
        timer = beside.node.create_timer(0.02, walk)
        beside.until(lambda: len(states) > 30)
        beside.until(lambda: os.sched_getscheduler(lab.pid) == HURRIED)
        busy = busy_beside(lab)
        timer.cancel()
        beside.until(lambda: not any(states[-1].velocity))
        late_s = (messages.nanoseconds(states[-1].header.stamp) - sent[-1]) * 1e-9
        assert 0.25 <= late_s <= LEGS_S + busy.seconds
        beside.until(lambda: said("legs stopped: no set-point for 0.25 s"))
        beside.until(lambda: os.sched_getscheduler(lab.pid) == os.SCHED_OTHER)

        count = len(states)
        send()  # the clock wakes up: its moving set-points are no start
        beside.until(lambda: any(value.key == "refused" and value.value == "1" for value in told[-1].values))
        assert len(states) == count
        send(0.0)
        send()
        beside.until(lambda: any(states[-1].velocity))  # after rest, they are

        timer = beside.node.create_timer(0.02, lambda: blower.publish(messages.float64(1.0)))
        beside.until(lambda: any(value.key == "blower" and value.value == "1.0" for value in told[-1].values))
        timer.cancel()
        beside.until(lambda: said("air off: nothing on /bed/blower for 0.45 s"))


def test_the_lab_obeys_nobody_who_is_gone_though_his_commands_go_on(beside, stand_in):
    states, told, asked = [], {}, {"rate": 0.0, "air": 0.0}
    setpoints, blower = (endpoints.publisher(beside.node, one) for one in (topics.LEG_SETPOINTS, topics.BED_BLOWER))
    endpoints.subscription(beside.node, topics.LEG_STATES, states.append)
    endpoints.subscription(
        beside.node, topics.DIAGNOSTICS, lambda message: told.update({one.name: one for one in message.status})
    )

    def command():
        angle = np.full(6, time.monotonic() % 1.0)
        setpoints.publish(messages.joint_state(time.time_ns(), topics.LEGS, angle, np.full(6, asked["rate"]), angle))
        blower.publish(messages.float64(asked["air"]))

    def blows():
        return {pair.key: pair.value for pair in told["lab"].values}["blower"] == "1.0"

    with running("sandbot_lab.nodes.lab_node", "images:=false", "legs_lease_s:=1.0", "air_lease_s:=2.0"):
        beside.until(lambda: setpoints.get_subscription_count() and blower.get_subscription_count() and "lab" in told)
        clock, bed = stand_in("clock"), stand_in("bed")
        command()  # told rest before they move
        beside.node.create_timer(0.02, command)
        asked["rate"] = OMEGA
        beside.until(lambda: states and any(states[-1].velocity))
        clock.kill()
        beside.until(lambda: told["lab"].message == "legs stopped: the clock is gone")
        # On a busy machine states are still on their way that were sent before.
        beside.until(lambda: not any(states[-1].velocity))
        asked["rate"] = 0.0
        beside.wait(lambda: False, 0.2)
        asked["rate"] = OMEGA
        beside.until(lambda: any(states[-1].velocity))  # another clock, of which nothing is known
        asked["rate"] = 0.0

        asked["air"] = 1.0
        beside.until(blows)
        bed.send_signal(signal.SIGSTOP)
        beside.until(lambda: told["lab"].message == "air off: the bed is frozen")
        bed.send_signal(signal.SIGCONT)
        beside.wait(blows, 0.5)
        assert not blows()  # it goes on commanding air, and that is no start
        asked["air"] = 0.0
        beside.wait(lambda: False, 0.2)
        asked["air"] = 1.0
        beside.until(blows)


class Bed:
    """Ears for the bed, a sensor of its height, and the lease."""

    def __init__(self, beside):
        self.beside, self.levels, self.reason = beside, [], ""
        self.commander = Commander(beside)
        height = endpoints.publisher(beside.node, topics.BED_HEIGHT)
        endpoints.subscription(beside.node, topics.BED_BLOWER, self._on_blower)
        endpoints.subscription(beside.node, topics.BED_STATUS, self._on_status)
        beside.node.create_timer(0.02, lambda: height.publish(messages.range_(0, 0.1, 0.0, 1.0, "bed")))

    def _on_blower(self, message):
        self.levels.append((time.time_ns(), message.data))

    def _on_status(self, message):
        self.reason = message.status[0].message

    def blow(self):
        """Prepare, again where a busy machine let the preparation fail at once, until the air is on."""

        def blows():
            self.commander.renewing, self.reason = True, ""
            return self.beside.call("/bed/prepare").success and self.beside.wait(lambda: self.levels[-1][1] > 0, 5.0)

        self.beside.until(lambda: self.levels)
        self.beside.until(blows)

    def fails(self, why, cause):
        """When the air was last on [ns], once it is off because of ``cause``; a busy machine may give causes itself."""

        def failed():
            self.blow()
            cause()
            self.beside.until(lambda: self.levels[-1][1] == 0.0)
            return self.beside.wait(lambda: why in self.reason, 5.0)

        self.beside.until(failed)
        return next(t_ns for t_ns, level in reversed(self.levels) if level > 0)


def test_the_bed_turns_the_air_off_by_itself_and_says_why(beside):
    bed = Bed(beside)
    with running("sandbot_bed.nodes.bed_node") as process:
        bed.commander.command()

        def falls_silent():
            nonlocal busy
            busy = busy_beside(process)
            bed.commander.renewing = False

        def freezes():
            process.send_signal(signal.SIGSTOP)
            beside.wait(lambda: False, 0.7)
            process.send_signal(signal.SIGCONT)

        busy = None
        last_ns = bed.fails("beside did not renew /operator/lease", falls_silent)
        assert (last_ns - bed.commander.renewed_ns) * 1e-9 <= AIR_S + busy.seconds
        refused = beside.call("/bed/prepare")
        assert not refused.success
        assert "does not renew" in refused.message

        bed.fails("held up", freezes)

        with running("sandbot_bed.nodes.bed_node") as second:
            _, said = second.communicate(timeout=60)
            assert second.returncode == 2
            assert "another bed is running already" in said

        beside.until(lambda: os.sched_getscheduler(process.pid) == os.SCHED_OTHER)
        bed.blow()
        beside.until(lambda: os.sched_getscheduler(process.pid) == HURRIED)
        said, code = ended(process, signal.SIGHUP)
        beside.until(lambda: bed.levels[-1][1] == 0.0)
        assert said[-1] == "bed: ended: SIGHUP"
        assert code == 0
        assert not any("Traceback" in line for line in said)
