"""The scene's shapes and poses as standard messages. The message classes are plain Python: ROS is not started."""

from collections.abc import Iterable, Sequence
from typing import Any

from geometry_msgs.msg import Point, TransformStamped
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from sandbot_bringup.scene import Pose, Shape
from sandbot_common.messages import header


def transform(t_ns: int, frame: str, pose: Pose) -> TransformStamped:
    """A frame's pose in the trackway frame."""
    message = TransformStamped(header=header(t_ns), child_frame_id=frame)
    _put(message.transform.translation, "xyz", pose.at_m)
    _put(message.transform.rotation, "xyzw", pose.turn)
    return message


def marker_array(t_ns: int, shapes: Sequence[Shape]) -> MarkerArray:
    """These shapes, which replace all drawn before."""
    clear = Marker(header=header(t_ns), action=Marker.DELETEALL)
    return MarkerArray(markers=[clear, *(_marker(t_ns, shape) for shape in shapes)])


def _marker(t_ns: int, shape: Shape) -> Marker:
    message = Marker(header=header(t_ns), ns=shape.group, type=shape.kind, action=Marker.ADD, text=shape.text)
    _put(message.pose.position, "xyz", shape.pose.at_m)
    _put(message.pose.orientation, "xyzw", shape.pose.turn)
    _put(message.scale, "xyz", shape.size_m)
    red, green, blue, alpha = shape.colour
    message.color = ColorRGBA(r=red, g=green, b=blue, a=alpha)
    message.points = [Point(x=x, y=y, z=z) for x, y, z in shape.points_m.tolist()]
    return message


def _put(message: Any, names: str, values: Iterable[float]) -> None:
    for name, value in zip(names, values, strict=True):
        setattr(message, name, float(value))
