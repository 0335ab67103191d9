"""Every topic of the trackway: name, type, and how it is delivered (design: SI units, REP-103).

Names are those in bags, and those of a trackway without a namespace. Nodes use them by ``relative``, so that in a
namespace (``-r __ns:=/robot1``) a whole trackway is separate: topics, services, health and lease.
"""

import math
import re
from dataclasses import dataclass
from typing import NamedTuple

LEGS = ("front_left", "middle_right", "rear_left", "front_right", "middle_left", "rear_right")
"""SandBot's joint names in the order of every array of legs: tripod A first, then tripod B (``Robot.leg_order``)."""

FRAME = "trackway"
"""x along the track, z up from the undisturbed surface."""

NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
"""What ROS accepts as the full name of a topic."""


@dataclass(frozen=True)
class Topic:
    """A topic; ``latched`` ones keep their last message for late subscribers (transient local).

    ``deadline_s``: while there is anything to command, a command is sent at least that often (decision 16). It is
    offered as DDS deadline and liveliness: a driver that requests the same is notified of a miss.
    """

    name: str
    type: str
    latched: bool = False
    depth: int = 50
    deadline_s: float = math.inf

    @property
    def relative(self) -> str:
        """The name within the namespace of the node that uses it."""
        return relative(self.name)


def relative(name: str) -> str:
    """The name of a topic or service within the namespace of the node that uses it."""
    return name.removeprefix("/")


LEG_SETPOINTS = Topic("/leg_setpoints", "sensor_msgs/msg/JointState", depth=2000, deadline_s=0.25)
LEG_STATES = Topic("/leg_states", "sensor_msgs/msg/JointState", depth=2000)
SYNC_LED = Topic("/sync_led", "std_msgs/msg/Header")
BED_HEIGHT = Topic("/bed/height", "sensor_msgs/msg/Range")
BED_BLOWER = Topic("/bed/blower", "std_msgs/msg/Float64", deadline_s=0.45)
BED_PHI = Topic("/bed/volume_fraction", "std_msgs/msg/Float64", latched=True, depth=1)
BED_STATUS = Topic("/bed/status", "diagnostic_msgs/msg/DiagnosticArray")
DORSAL_IMAGE = Topic("/camera/dorsal/image_raw", "sensor_msgs/msg/Image", depth=200)
DORSAL_INFO = Topic("/camera/dorsal/camera_info", "sensor_msgs/msg/CameraInfo", depth=200)
DORSAL_JPEG = Topic("/camera/dorsal/image_raw/compressed", "sensor_msgs/msg/CompressedImage", depth=200)
LATERAL_IMAGE = Topic("/camera/lateral/image_raw", "sensor_msgs/msg/Image", depth=200)
LATERAL_INFO = Topic("/camera/lateral/camera_info", "sensor_msgs/msg/CameraInfo", depth=200)
LATERAL_JPEG = Topic("/camera/lateral/image_raw/compressed", "sensor_msgs/msg/CompressedImage", depth=200)


class View(NamedTuple):
    """What one camera publishes: pictures, its calibration, and the pictures as JPEG."""

    image: Topic
    info: Topic
    jpeg: Topic


VIEWS = {
    "dorsal": View(DORSAL_IMAGE, DORSAL_INFO, DORSAL_JPEG),
    "lateral": View(LATERAL_IMAGE, LATERAL_INFO, LATERAL_JPEG),
}
"""By the camera's name."""


def optical_frame(camera: str) -> str:
    """The frame of a camera's pictures (REP 103: x right, y down, z forward)."""
    return f"{camera}_optical_frame"


COM = Topic("/landmarks/com", "geometry_msgs/msg/PointStamped", depth=200)
FRONT_AXLE = Topic("/landmarks/front_axle", "geometry_msgs/msg/PointStamped", depth=200)
REAR_AXLE = Topic("/landmarks/rear_axle", "geometry_msgs/msg/PointStamped", depth=200)
LANDMARKS = {"com": COM, "front_axle": FRONT_AXLE, "rear_axle": REAR_AXLE}
"""By the landmark's name."""
SPEED = Topic("/speed", "geometry_msgs/msg/TwistWithCovarianceStamped", depth=200)
SPEED_MEAN = Topic("/speed/mean", "std_msgs/msg/Float64")
LIFT = Topic("/lift", "std_msgs/msg/Float64")
MODEL_SPEED = Topic("/model/speed", "geometry_msgs/msg/TwistWithCovarianceStamped", depth=200)
MODEL_SPEED_MEAN = Topic("/model/speed/mean", "std_msgs/msg/Float64")
MODEL_ERROR = Topic("/model/error", "std_msgs/msg/Float64")
OPERATOR_LEASE = Topic("/operator/lease", "std_msgs/msg/Header", depth=1, deadline_s=0.25)
"""Renewed by the commander of bed and clock (a campaign); without it they stop by themselves. frame_id: its name, and
what it lets begin if not anything, e.g. "campaign legs" (``command_node``)."""
TRIAL = Topic("/trial", "std_msgs/msg/String", latched=True, depth=1)
DIAGNOSTICS = Topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")

ALL = tuple(value for value in list(globals().values()) if isinstance(value, Topic))
"""All topics of a trial, in the order above."""

COMMANDS = (LEG_SETPOINTS, BED_BLOWER, OPERATOR_LEASE)
"""What legs and air obey."""
MEASURED = (
    TRIAL, LEG_SETPOINTS, LEG_STATES, SYNC_LED, BED_HEIGHT, BED_BLOWER, BED_PHI, BED_STATUS, *LANDMARKS.values(),
    *(pictures for view in VIEWS.values() for pictures in (view.image, view.jpeg)),
)  # fmt: skip
"""What a row of the trials table is computed from or judged by. Only one node may publish each of them: a message
does not name its sender."""

HEARTBEAT = Topic("/heartbeat", "std_msgs/msg/Header")
"""20 times a second from every process, however busy its node; frame_id: the node, stamp: when its loop last turned.
Not recorded."""
CAMPAIGN_STATUS = Topic("/campaign/status", "std_msgs/msg/String", latched=True, depth=1)
"""JSON: the queue, the trial under way, why it is held, and answers to commands. No part of a trial: not recorded."""
CAMPAIGN_COMMAND = Topic("/campaign/command", "std_msgs/msg/String", depth=10)
"""JSON: skip, repeat, add. Never latched: an old order must not be obeyed by the next campaign."""
MODEL_CURVE = Topic("/model/curve", "std_msgs/msg/String", latched=True, depth=1)
"""JSON: the model's mean speed against the leg frequency at the volume fraction of the trial under way."""
SCENE = Topic("/scene", "visualization_msgs/msg/MarkerArray", depth=1)
"""Bed, robot and marks as shapes, for RViz and Foxglove. Derived from other topics: not recorded; nor is the next."""
FRAMES = Topic("/frames", "geometry_msgs/msg/TransformStamped")
"""Where the robot's body (base_link) and the cameras' optical frames are."""

UNRECORDED = (CAMPAIGN_STATUS, MODEL_CURVE, HEARTBEAT, SCENE, FRAMES)
"""Topics that are no part of a trial and so not recorded, but open to any reader."""
