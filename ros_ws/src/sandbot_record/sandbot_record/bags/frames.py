"""Camera frames without ROS: the pixels of a raw image message, and the message that stands for them in a bag."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandbot_common.errors import InputError
from sandbot_record.bags import interfaces

RAW, JPEG = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
QUALITY = 90
_SUFFIX = "/compressed"
_CHANNELS = {"mono8": 1, "bgr8": 3}

Pixels = NDArray[np.uint8]


def compressed_name(topic: str) -> str:
    """Where image_transport puts the compressed images of a topic."""
    return f"{topic}{_SUFFIX}"


def raw_name(topic: str, type_name: str) -> str | None:
    """The raw image topic of a topic of compressed images; None if it is not one."""
    return topic.removesuffix(_SUFFIX) if type_name == JPEG and topic.endswith(_SUFFIX) else None


def encode_jpeg(pixels: Pixels) -> bytes:
    """Pixels (height, width) or (height, width, 3; BGR) as a JPEG file."""
    import cv2

    return bytes(cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes())


def pixels_of(cdr: bytes | memoryview, aim: str) -> tuple[Any, Pixels]:
    """A CDR sensor_msgs/Image and its pixels (height, width[, 3]), a view.

    Raises InputError, naming the ``aim``, if it is neither mono8 nor bgr8, has no pixels, or has another size than its
    height and step give.
    """
    image = interfaces.decode(cdr, RAW)
    channels = _CHANNELS.get(image.encoding)
    if channels is None:
        raise InputError(f"image encoding {image.encoding!r} can't become {aim}: mono8 or bgr8 is needed")
    if not (image.height and image.width):
        raise InputError(f"an image of {image.width} x {image.height} pixels can't become {aim}")
    try:
        rows = image.data.reshape(image.height, image.step)[:, : image.width * channels]
        return image, rows.reshape(image.height, image.width, channels) if channels > 1 else rows
    except ValueError:
        raise InputError(f"image of {image.data.size} bytes is not {image.height} rows of {image.step}") from None


def to_jpeg(cdr: bytes | memoryview) -> bytes:
    """A CDR sensor_msgs/Image (mono8 or bgr8) as a CDR CompressedImage. Raises InputError on another encoding."""
    image, pixels = pixels_of(cdr, "JPEG")
    store = interfaces.store()
    message = store.types[JPEG](
        header=image.header,
        format=f"{image.encoding}; jpeg compressed {image.encoding}",
        data=np.frombuffer(encode_jpeg(pixels), np.uint8),
    )
    return bytes(store.serialize_cdr(message, JPEG))


def from_jpeg(cdr: bytes | memoryview) -> bytes:
    """A CDR CompressedImage as a CDR sensor_msgs/Image (mono8). Raises InputError if it can't be decoded."""
    message = interfaces.decode(bytes(cdr), JPEG)
    return to_image(message.header, grey_of_jpeg(message.data))


def grey_of_jpeg(data: Pixels) -> Pixels:
    """Pixels (height, width) of a JPEG file's bytes. Raises InputError if it can't be decoded."""
    import cv2

    pixels = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
    if pixels is None:
        raise InputError(f"{data.size} bytes of a compressed image are not a picture")
    return np.asarray(pixels, dtype=np.uint8)


def to_image(header: Any, pixels: Pixels) -> bytes:
    """Pixels (height, width) as a CDR sensor_msgs/Image of encoding mono8."""
    store = interfaces.store()
    height, width = pixels.shape
    message = store.types[RAW](
        header=header,
        height=height,
        width=width,
        encoding="mono8",
        is_bigendian=0,
        step=width,
        data=np.ascontiguousarray(pixels).ravel(),
    )
    return bytes(store.serialize_cdr(message, RAW))
