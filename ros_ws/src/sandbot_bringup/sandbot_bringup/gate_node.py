"""What must be there before a campaign begins and before each of its trials: nodes, rates, one commander, disk."""

import math
import shutil
from functools import partial

from rclpy.node import Node

from sandbot_bed.protocol import ProtocolParameters
from sandbot_bringup.endings import CampaignEnds
from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.hearing_node import DRIVERS, Hearing
from sandbot_bringup.orders_node import Orders, Wait
from sandbot_bringup.supervision import pace_fault
from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_common.files import writing
from sandbot_common.node import NAMELESS, names_of

DISCOVERY_S = 20.0
"""Nodes that just started need this long at most to be seen on a busy machine."""
FREE_BYTES = 300 << 20
"""Room there must be before a trial; the recorder itself stops at 200 MiB."""
FORGOTTEN_S = 30.0
"""A process that was killed stays in DDS's graph for 20 s; one of another name is taken for a commander until then."""
PACE_S = 0.5
"""How long rates are measured before a trial."""

_REQUIRED = ("clock", "bed", "tracker")
_START_THEM = "start the nodes with: ros2 launch sandbot_bringup trackway.launch.py"


class Gate:
    """Lets a campaign and its trials begin, or says what is missing."""

    def __init__(self, node: Node, hearing: Hearing, orders: Orders, wait: Wait) -> None:
        self._node, self._hearing, self._orders, self._wait = node, hearing, orders, wait
        self.has_lab = False
        """Whether the robot is the virtual lab."""

    def find_nodes(self) -> None:
        """Wait for all that a trial needs; InputError naming what is missing."""
        for name in ("/clock/start", "/bed/prepare"):
            if not self._wait(partial(self._orders.is_offered, name), DISCOVERY_S):
                raise InputError(f"no node offers {name}; {_START_THEM}")
        for topic in (topics.LEG_STATES, topics.COM):
            if not self._wait(partial(self._is_published, topic), DISCOVERY_S):
                raise InputError(f"no node publishes {topic.name}; {_START_THEM}")
        # Seeing its service is not enough: a preparation fails at once while the bed has not heard its height sensor.
        if not self._wait(lambda: math.isfinite(self._hearing.bed_height_m), DISCOVERY_S):
            raise InputError(f"the bed node has no reading on {topics.BED_HEIGHT.name}; {_START_THEM}")
        # Whoever reports the legs is the robot: the virtual lab takes a seed and a reset, a real one is carried back.
        # A publisher can be seen before the name of its node is: guessing then would leave the seed unset.
        if not self._wait(lambda: NAMELESS not in self._who_publishes(topics.LEG_STATES), DISCOVERY_S):
            raise InputError(f"the node that publishes {topics.LEG_STATES.name} does not tell its name; {_START_THEM}")
        self.has_lab = "lab" in self._who_publishes(topics.LEG_STATES)
        if self.has_lab and not self._wait(partial(self._orders.is_offered, "/lab/reset"), DISCOVERY_S):
            raise InputError(f"the virtual lab does not offer /lab/reset; {_START_THEM}")
        if not self._wait(lambda: set(self._required) <= self._hearing.told.keys(), DISCOVERY_S):
            missing = next(name for name in self._required if name not in self._hearing.told)
            raise InputError(f"the {missing} does not tell its health on {topics.DIAGNOSTICS.name}; {_START_THEM}")

    def before_trial(self, bed: ProtocolParameters, folder: CampaignFolder) -> None:
        """All that a trial needs is there, once, and alive; CampaignEnds with what is not."""
        self._hearing.require([*self._required, *(name for name in DRIVERS if name in self._hearing.told)])
        if not self._wait(lambda: not self._hearing.missing(), DISCOVERY_S):
            missing = self._hearing.missing()[0]
            raise CampaignEnds(f"the {missing}; {_START_THEM}, then start the campaign again to go on")
        # A trial that failed may have left them moving, and the air comes next.
        if not self._wait(lambda: not self._hearing.tells_motion, DISCOVERY_S):
            where = topics.LEG_STATES.name
            raise CampaignEnds(f"legs do not come to rest ({where}); stop them, then start the campaign again to go on")
        self._pace(bed)
        for topic in (topics.LEG_SETPOINTS, topics.BED_BLOWER, topics.OPERATOR_LEASE):
            if not self._wait(partial(self._has_one_publisher, topic), FORGOTTEN_S):
                names = " and ".join(self._who_publishes(topic)) or "nobody"
                raise CampaignEnds(f"{names} publish {topic.name}: one commander is needed, and only one")
        with writing(folder.path):
            free = shutil.disk_usage(folder.path).free
        if free < FREE_BYTES:
            raise CampaignEnds(f"{folder.path}: only {free >> 20} MiB free, a trial needs {FREE_BYTES >> 20}")

    def _pace(self, bed: ProtocolParameters) -> None:
        """Sensors run at their rates; CampaignEnds with what does not."""
        hearing = self._hearing
        # With fewer heights than that a rest of the bed would time out.
        least_hz = bed.min_readings / (bed.average_s + bed.overrun_s)
        since_s, heights, before = hearing.now_s, hearing.heights, hearing.told["tracker"].values
        faults = [""]

        def paced() -> bool:
            rate_hz = (hearing.heights - heights) / max(hearing.now_s - since_s, PACE_S)
            slow = f"{topics.BED_HEIGHT.name} comes at {rate_hz:.1f} Hz, {least_hz:.1f} are needed"
            # The virtual lab takes frames when it has the time, and gives them the stamps of even ones.
            cameras = "" if self.has_lab else pace_fault(before, hearing.told["tracker"].values)
            faults[0] = slow if rate_hz < least_hz else cameras
            return not faults[0] and hearing.now_s - since_s >= PACE_S

        if not self._wait(paced, DISCOVERY_S):
            raise CampaignEnds(f"{faults[0]}; mend it, then start the campaign again to go on")

    @property
    def _required(self) -> tuple[str, ...]:
        """Who must tell his health: a robot of another maker need not."""
        return (*_REQUIRED, "lab") if self.has_lab else _REQUIRED

    def _who_publishes(self, topic: topics.Topic) -> list[str]:
        return names_of(self._node.get_publishers_info_by_topic(topic.relative))

    def _has_one_publisher(self, topic: topics.Topic) -> bool:
        return len(self._who_publishes(topic)) == 1

    def _is_published(self, topic: topics.Topic) -> bool:
        return bool(self._node.count_publishers(topic.relative))
