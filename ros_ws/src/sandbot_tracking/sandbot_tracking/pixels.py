"""Grey pixels from any camera's image message: the encodings of ROS drivers (REP-118, sensor_msgs/image_encodings)."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Frame
from sandbot_common.errors import InputError


@dataclass(frozen=True)
class _Layout:
    """Memory layout of a pixel, and its conversion to grey."""

    channels: int = 1
    depth: int = 8
    """Bits of one channel: 8 or 16."""
    code: int | None = None
    """OpenCV's conversion to grey."""
    luma: int | None = None
    """The channel that is already grey, as in YUV."""


def _bayer(pattern: str, code: int) -> dict[str, _Layout]:
    return {f"bayer_{pattern}{depth}": _Layout(depth=depth, code=code) for depth in (8, 16)}


_LAYOUTS: Mapping[str, _Layout] = MappingProxyType(
    {
        "mono8": _Layout(),
        "8UC1": _Layout(),
        "mono16": _Layout(depth=16),
        "16UC1": _Layout(depth=16),
        "bgr8": _Layout(3, code=cv2.COLOR_BGR2GRAY),
        "8UC3": _Layout(3, code=cv2.COLOR_BGR2GRAY),
        "rgb8": _Layout(3, code=cv2.COLOR_RGB2GRAY),
        "bgra8": _Layout(4, code=cv2.COLOR_BGRA2GRAY),
        "rgba8": _Layout(4, code=cv2.COLOR_RGBA2GRAY),
        "yuv422": _Layout(2, luma=1),
        "uyvy": _Layout(2, luma=1),
        "yuv422_yuy2": _Layout(2, luma=0),
        "yuyv": _Layout(2, luma=0),
        **_bayer("rggb", cv2.COLOR_BayerRGGB2GRAY),
        **_bayer("bggr", cv2.COLOR_BayerBGGR2GRAY),
        **_bayer("gbrg", cv2.COLOR_BayerGBRG2GRAY),
        **_bayer("grbg", cv2.COLOR_BayerGRBG2GRAY),
    }
)
_DECODED = {(): _LAYOUTS["mono8"], (3,): _LAYOUTS["bgr8"], (4,): _LAYOUTS["bgra8"]}
"""Layout of a decoded picture, by its shape after height and width."""
ENCODINGS = tuple(_LAYOUTS)
"""Encodings of raw images that can be read."""


def grey(image: Any, bits: int = 16) -> Frame:
    """The pixels (height, width) of a sensor_msgs Image or CompressedImage as 8-bit grey.

    ``bits``: how many of a 16-bit channel's bits the sensor fills (12-bit sensors often leave the upper four empty).
    mono8 is a view on the message's bytes. Raises InputError for an encoding or a size that can't be read.
    """
    rows = _compressed(image) if hasattr(image, "format") else _raw(image)
    if rows.dtype == np.uint8:
        return np.asarray(rows, dtype=np.uint8)
    # Saturated, not wrapped: a sensor that fills more bits than stated gives white, not dark pixels.
    return np.asarray(np.minimum(rows >> (bits - 8), 255), dtype=np.uint8)


def _raw(image: Any) -> NDArray[Any]:
    layout = _LAYOUTS.get(image.encoding)
    if layout is None:
        raise InputError(
            f"image encoding {image.encoding!r} can't be read; known: {', '.join(ENCODINGS)}, or compressed"
        )
    return _to_grey(_rows(image, layout), layout)


def _rows(image: Any, layout: _Layout) -> NDArray[Any]:
    """The pixels (height, width[, channels]) without row padding, in this machine's byte order."""
    length = image.width * layout.channels * layout.depth // 8
    data = np.frombuffer(image.data, dtype=np.uint8)
    if not (image.height and image.width and image.step >= length and data.size >= image.height * image.step):
        raise InputError(
            f"{image.encoding} image of {image.width}x{image.height} with rows of {image.step} bytes, {data.size} in "
            f"all: at least {image.height} rows of {length} are needed"
        )
    rows: NDArray[Any] = data[: image.height * image.step].reshape(image.height, image.step)[:, :length]
    if layout.depth == 16:
        rows = np.ascontiguousarray(rows).view(">u2" if image.is_bigendian else "<u2").astype(np.uint16)
    return np.asarray(rows if layout.channels == 1 else rows.reshape(image.height, image.width, layout.channels))


def _to_grey(rows: NDArray[Any], layout: _Layout) -> NDArray[Any]:
    if layout.luma is not None:
        return np.ascontiguousarray(rows[:, :, layout.luma])
    if layout.code is None:
        return rows
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(rows), layout.code))


def _compressed(image: Any) -> NDArray[Any]:
    """JPEG or PNG, as image_transport sends them; the format field identifies a compressed raw Bayer mosaic."""
    data = np.frombuffer(image.data, dtype=np.uint8)
    # Unchanged: in grey mode OpenCV would reduce 16 bits to their upper eight, and rotate pictures by their EXIF tag.
    pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    decoded = None if pixels is None else _DECODED.get(pixels.shape[2:])
    if pixels is None or decoded is None or pixels.dtype not in (np.uint8, np.uint16):
        raise InputError(f"compressed image of format {image.format!r}: {data.size} bytes are not a picture")
    encoding = image.format.partition(";")[0].strip()
    # Three colour channels are not a mosaic, whatever the format says: the driver has converted it.
    mosaic = encoding.startswith("bayer") and encoding in _LAYOUTS and pixels.ndim == 2
    return _to_grey(pixels, _LAYOUTS[encoding] if mosaic else decoded)
