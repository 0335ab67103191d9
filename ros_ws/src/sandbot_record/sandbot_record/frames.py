"""Raw image messages to JPEG ones, without ROS."""

import cv2
import numpy as np

from sandbot_common.errors import InputError
from sandbot_record import interfaces

RAW, JPEG = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
QUALITY = 90
_CHANNELS = {"mono8": 1, "bgr8": 3}


def compressed_name(topic: str) -> str:
    """Where image_transport puts the compressed images of a topic."""
    return f"{topic}/compressed"


def to_jpeg(cdr: bytes) -> bytes:
    """A CDR sensor_msgs/Image (mono8 or bgr8) as a CDR CompressedImage. Raises InputError on another encoding."""
    image = interfaces.decode(cdr, RAW)
    channels = _CHANNELS.get(image.encoding)
    if channels is None:
        raise InputError(f"image encoding {image.encoding!r} can't become JPEG: mono8 or bgr8 is needed")
    try:
        rows = image.data.reshape(image.height, image.step)[:, : image.width * channels]
    except ValueError:
        raise InputError(f"image of {image.data.size} bytes is not {image.height} rows of {image.step}") from None
    pixels = rows.reshape(image.height, image.width, channels) if channels > 1 else rows
    data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
    store = interfaces.store()
    message = store.types[JPEG](
        header=image.header, format=f"{image.encoding}; jpeg compressed {image.encoding}", data=np.asarray(data).ravel()
    )
    return bytes(store.serialize_cdr(message, JPEG))
