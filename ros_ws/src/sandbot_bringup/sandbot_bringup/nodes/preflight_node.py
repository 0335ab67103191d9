"""Preconditions of a campaign and of each of its trials: nodes, rates, one publisher of each topic, disk space."""

import math
import shutil
from functools import partial

from rclpy.node import Node

from sandbot_bed.protocol import ProtocolParameters
from sandbot_bringup.endings import CampaignEnds
from sandbot_bringup.folder import CampaignFolder
from sandbot_bringup.nodes.monitor_node import DRIVERS, Monitor
from sandbot_bringup.nodes.services_node import ServiceClients, Wait
from sandbot_bringup.supervision import pace_fault
from sandbot_common import topics
from sandbot_common.errors import InputError
from sandbot_common.files import writing
from sandbot_common.health import CALIBRATION, TIMELESS
from sandbot_common.ros import endpoints
from sandbot_common.ros.endpoints import NAMELESS, names_of
from sandbot_common.shared_memory import check_room
from sandbot_tracking.calibration import checksum, read_cameras

DISCOVERY_S = 20.0
"""The longest that nodes which just started take to be discovered on a busy machine."""
FREE_BYTES = 300 << 20
"""Free space needed before a trial without frames; the recorder itself stops at 200 MiB."""
FORGOTTEN_S = 30.0
"""A killed process stays in DDS's graph for 20 s; one of another name counts as a publisher until then."""
PACE_S = 0.5
"""How long rates are measured before a trial."""

_OURSELVES = "campaign"
_REQUIRED = ("clock", "bed", "tracker")
_START_THEM = "start the nodes with: ros2 launch sandbot_bringup trackway.launch.py"


class Preflight:
    """Checks that a campaign and its trials may begin; the error says what is missing."""

    def __init__(self, node: Node, monitor: Monitor, services: ServiceClients, wait: Wait) -> None:
        self._node, self._monitor, self._service_clients, self._wait = node, monitor, services, wait
        self.has_lab = False
        """Whether the robot is the virtual lab."""

    def find_nodes(self) -> None:
        """Wait for everything a trial needs. Raises InputError naming what is missing."""
        for name in ("/clock/start", "/bed/prepare"):
            if not self._wait(partial(self._service_clients.is_offered, name), DISCOVERY_S):
                raise self._nobody("offers", name)
        for topic in (topics.LEG_STATES, topics.COM):
            if not self._wait(partial(self._is_published, topic), DISCOVERY_S):
                raise self._nobody("publishes", topic.name)
        # The service is not enough: a preparation fails at once before the bed has received a height reading.
        if not self._wait(lambda: math.isfinite(self._monitor.bed_height_m), DISCOVERY_S):
            unheard = endpoints.unheard(self._node, topics.BED_HEIGHT)
            raise InputError(unheard or self._with_remedy(f"bed node has no reading on {topics.BED_HEIGHT.name}"))
        # The node that reports the legs is the robot: the virtual lab takes a seed and a reset, a real one is carried
        # back. A publisher may be discovered before its node's name: guessing then could leave the seed unset.
        if not self._wait(lambda: NAMELESS not in self._who_publishes(topics.LEG_STATES), DISCOVERY_S):
            raise InputError(f"the node that publishes {topics.LEG_STATES.name} has no known name; {_START_THEM}")
        self.has_lab = "lab" in self._who_publishes(topics.LEG_STATES)
        if self.has_lab and not self._wait(partial(self._service_clients.is_offered, "/lab/reset"), DISCOVERY_S):
            raise InputError(f"the virtual lab does not offer /lab/reset; {_START_THEM}")
        if not self._wait(lambda: set(self._required) <= self._monitor.statuses.keys(), DISCOVERY_S):
            missing = next(name for name in self._required if name not in self._monitor.statuses)
            raise InputError(f"the {missing} does not report its health on {topics.DIAGNOSTICS.name}; {_START_THEM}")

    def _nobody(self, does: str, name: str) -> InputError:
        """With domain and namespace: nodes that run in another one are not seen from here."""
        space, domain = self._node.get_namespace().rstrip("/"), self._node.context.get_domain_id()
        return InputError(f"no node {does} {space}{name} in ROS_DOMAIN_ID {domain}; {_START_THEM}")

    def before_trial(self, bed: ProtocolParameters, folder: CampaignFolder, lossless_s: float = 0.0) -> None:
        """Check that everything a trial needs is present, once, and alive. Raises CampaignEnds naming what is not.

        ``lossless_s``: how long frames are stored lossless in it, which fills a disk sooner than anything else.
        """
        self._monitor.require(self._reporting)
        if not self._wait(lambda: not self._monitor.missing(), DISCOVERY_S):
            missing = self._with_remedy(self._monitor.missing()[0])
            raise CampaignEnds(f"{missing}, then start the campaign again to go on")
        # A failed trial may have left the legs moving, and the air comes next.
        if not self._wait(lambda: not self._monitor.reports_motion, DISCOVERY_S):
            where = topics.LEG_STATES.name
            raise CampaignEnds(f"legs do not come to rest ({where}); stop them, then start the campaign again to go on")
        if not self._wait(lambda: not self._timeless, DISCOVERY_S):
            raise CampaignEnds(f"{self._timeless}; set it to false, then start the campaign again to go on")
        self._same_cameras(folder)
        self._pace(bed)
        for topic in topics.COMMANDS:
            if not self._wait(partial(self._has_one_publisher, topic), FORGOTTEN_S):
                names = " and ".join(self._who_publishes(topic)) or "nobody"
                raise CampaignEnds(f"{names} publish {topic.name}: one commander is needed, and only one")
        for topic in (*topics.COMMANDS, *topics.MEASURED):
            if unheard := endpoints.unheard(self._node, topic, reliable=topic in topics.COMMANDS):
                raise CampaignEnds(f"{unheard}; fix it, then start the campaign again to go on")
        rivals = self._monitor.rivals
        if not self._wait(lambda: not rivals.fault(), FORGOTTEN_S):
            raise CampaignEnds(f"{rivals.fault()}; end one of them, then start the campaign again to go on")
        with writing(folder.path):
            free = shutil.disk_usage(folder.path).free
        needed = FREE_BYTES + (round(lossless_s * _film_bytes_s(folder)) if lossless_s else 0)
        if free < needed:
            raise CampaignEnds(f"{folder.path}: only {free >> 20} MiB free, the next trial needs {needed >> 20}")
        try:
            check_room()
        except InputError as error:
            raise CampaignEnds(f"{error}, then start the campaign again to go on") from None

    @property
    def _timeless(self) -> str:
        """Which node's stamps show no time, and why; an empty string if all do."""
        statuses = self._monitor.statuses
        heard = ((who, statuses[who].values) for who in (_OURSELVES, *self._reporting) if who in statuses)
        return next((f"{who}: {values[TIMELESS]}" for who, values in heard if TIMELESS in values), "")

    @property
    def _reporting(self) -> list[str]:
        """Nodes whose health must be heard."""
        return [*self._required, *(name for name in DRIVERS if name in self._monitor.statuses)]

    def _same_cameras(self, folder: CampaignFolder) -> None:
        """Check that the tracker measures by the calibration that bags will state. Raises CampaignEnds."""
        path = folder.path / "cameras.yaml"
        if self._monitor.statuses["tracker"].values.get(CALIBRATION) not in (None, checksum(read_cameras(path))):
            wrong = f"the tracker measures by another calibration than {path}"
            raise CampaignEnds(f"{wrong}; start it with cameras:={path}, then start the campaign again to go on")

    def _with_remedy(self, missing: str) -> str:
        """What to do about it; a driver that has lost its device explains it, and is running already."""
        unplugged = self._monitor.unplugged()
        return f"the {unplugged[0]}; fix it" if unplugged else f"the {missing}; {_START_THEM}"

    def _pace(self, bed: ProtocolParameters) -> None:
        """Check that the sensors run at their rates. Raises CampaignEnds naming one that does not."""
        monitor = self._monitor
        # At a lower rate of heights a rest of the bed would time out.
        least_hz = bed.min_readings / (bed.average_s + bed.overrun_s)
        since_s, heights, before = monitor.now_s, monitor.heights, monitor.statuses["tracker"].values
        faults = [""]

        def paced() -> bool:
            rate_hz = (monitor.heights - heights) / max(monitor.now_s - since_s, PACE_S)
            slow = f"{topics.BED_HEIGHT.name} comes at {rate_hz:.1f} Hz, {least_hz:.1f} are needed"
            # The virtual lab renders frames when it has time, but stamps them at a regular rate.
            cameras = "" if self.has_lab else pace_fault(before, monitor.statuses["tracker"].values)
            faults[0] = slow if rate_hz < least_hz else cameras
            return not faults[0] and monitor.now_s - since_s >= PACE_S

        if not self._wait(paced, DISCOVERY_S):
            raise CampaignEnds(f"{faults[0]}; fix it, then start the campaign again to go on")

    @property
    def _required(self) -> tuple[str, ...]:
        """Nodes that must report their health; a third-party robot need not."""
        return (*_REQUIRED, "lab") if self.has_lab else _REQUIRED

    def _who_publishes(self, topic: topics.Topic) -> list[str]:
        return names_of(self._node.get_publishers_info_by_topic(topic.relative))

    def _has_one_publisher(self, topic: topics.Topic) -> bool:
        return len(self._who_publishes(topic)) == 1

    def _is_published(self, topic: topics.Topic) -> bool:
        return bool(self._node.count_publishers(topic.relative))


def _film_bytes_s(folder: CampaignFolder) -> float:
    """Bytes a second of both cameras' frames, uncompressed."""
    cameras = read_cameras(folder.path / "cameras.yaml").values()
    return sum(camera.width * camera.height * camera.frame_rate_hz for camera in cameras)
