"""Conversion between numpy and standard ROS messages. The message classes are plain Python: ROS is not started."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PointStamped, TwistWithCovarianceStamped
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, JointState, Range
from std_msgs.msg import Float64, Header, String

from sandbot_common.arrays import Floats
from sandbot_common.topics import FRAME

_NANO = 1_000_000_000


def message_class(name: str) -> Any:
    """The class of a type name such as ``sensor_msgs/msg/Image``."""
    package, _, kind = name.split("/")
    return getattr(import_module(f"{package}.msg"), kind)


def stamp(t_ns: int) -> Time:
    """Integer nanoseconds as a ROS time."""
    return Time(sec=t_ns // _NANO, nanosec=t_ns % _NANO)


def nanoseconds(time: Time) -> int:
    """A ROS time as integer nanoseconds."""
    return int(time.sec) * _NANO + int(time.nanosec)


def header(t_ns: int, frame: str = FRAME) -> Header:
    """A header at ``t_ns`` in ``frame``."""
    return Header(stamp=stamp(t_ns), frame_id=frame)


def joint_state(t_ns: int, names: Sequence[str], position: Floats, velocity: Floats, effort: Floats) -> JointState:
    """Leg angles [rad], rates [rad/s] and torques [N m], each of shape (n_legs,)."""
    return JointState(
        header=header(t_ns, ""),
        name=list(names),
        position=position.tolist(),
        velocity=velocity.tolist(),
        effort=effort.tolist(),
    )


def point(t_ns: int, xyz_m: Sequence[float] | Floats) -> PointStamped:
    """A landmark [m; trackway frame]; NaN where it was not seen."""
    message = PointStamped(header=header(t_ns))
    message.point.x, message.point.y, message.point.z = (float(value) for value in xyz_m)
    return message


def twist(t_ns: int, v_x: float, v_z: float, var_x: float, var_z: float) -> TwistWithCovarianceStamped:
    """Velocity [m/s] with variances [m²/s²]; what is not measured (y and rotation) has variance -1."""
    message = TwistWithCovarianceStamped(header=header(t_ns))
    message.twist.twist.linear.x, message.twist.twist.linear.z = float(v_x), float(v_z)
    covariance = np.zeros((6, 6))
    np.fill_diagonal(covariance, -1.0)
    covariance[0, 0], covariance[2, 2] = var_x, var_z
    message.twist.covariance = covariance.ravel()
    return message


def float64(value: float) -> Float64:
    """A bare number."""
    return Float64(data=float(value))


def string(text: str) -> String:
    """A bare string."""
    return String(data=text)


def range_(t_ns: int, range_m: float, low_m: float, high_m: float, frame: str) -> Range:
    """A height or distance reading [m] with the sensor's limits."""
    message = Range(header=header(t_ns, frame), radiation_type=Range.INFRARED)
    message.range, message.min_range, message.max_range = float(range_m), float(low_m), float(high_m)
    return message


def image(t_ns: int, frame_id: str, pixels: NDArray[np.uint8]) -> Image:
    """A mono8 image from pixels of shape (height, width)."""
    height, width = pixels.shape
    message = Image(header=header(t_ns, frame_id), height=height, width=width, encoding="mono8", step=width)
    # The setter would check every byte of a bytes object, but takes an array('B') unchecked.
    message.data.frombytes(pixels.tobytes())
    return message


def jpeg(t_ns: int, frame_id: str, data: bytes) -> CompressedImage:
    """A mono8 image as JPEG bytes."""
    message = CompressedImage(header=header(t_ns, frame_id), format="mono8; jpeg compressed mono8")
    message.data.frombytes(data)
    return message


def camera_info(
    t_ns: int, frame_id: str, size: tuple[int, int], matrix: Floats, distortion: Sequence[float]
) -> CameraInfo:
    """A camera's size (width, height) [px], matrix K (3, 3) and plumb-bob distortion k1, k2, p1, p2, k3."""
    return CameraInfo(
        header=header(t_ns, frame_id),
        width=size[0],
        height=size[1],
        distortion_model="plumb_bob",
        d=list(distortion),
        k=matrix.ravel().tolist(),
        r=np.eye(3).ravel().tolist(),
        p=np.column_stack([matrix, np.zeros(3)]).ravel().tolist(),
    )


def diagnostics(
    t_ns: int, name: str, values: Mapping[str, object], *, level: int = 0, text: str = "ok"
) -> DiagnosticArray:
    """One status with key-value pairs; level 0 ok, 1 warning, 2 error."""
    status = DiagnosticStatus(
        level=bytes([level]),
        name=name,
        message=text,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
    return DiagnosticArray(header=header(t_ns, ""), status=[status])


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    """The key-value pairs of a status."""
    return {pair.key: pair.value for pair in status.values}
