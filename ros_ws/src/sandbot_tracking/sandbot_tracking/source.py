"""Frames from a video file or a camera device, mono8."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sandbot_common.arrays import Frame
from sandbot_common.errors import InputError


class Source:
    """An open video: ``name``, ``rate_hz``, ``width``, ``height``, ``is_device`` and its frames. Use it in ``with``."""

    def __init__(self, video: str) -> None:
        """Open a file, or a device by number or /dev/video*. Raises InputError if it gives no frame."""
        device = int(video) if video.isdigit() else None
        self.is_device = device is not None or video.startswith("/dev/")
        if device is None and not Path(video).exists():
            raise InputError(f"{video}: no such video file or device")
        if device is None and Path(video).is_dir():
            raise InputError(f"{video}: is a folder, expected a video file")
        self.name = f"camera device {video}" if device is not None else video
        self._capture = _quietly_open(video if device is None else device)
        ok, first = self._capture.read() if self._capture.isOpened() else (False, None)
        if not ok or first is None:
            self._capture.release()
            raise InputError(f"{self.name}: not a readable video (no frame could be decoded)")
        self._first: Frame | None = mono8(first, self.name)
        self.height, self.width = self._first.shape
        self.rate_hz = float(self._capture.get(cv2.CAP_PROP_FPS))
        self.stamp_s = self._stamp_s()
        """Of the last frame read, by the film's own clock; of a film without one it does not grow."""

    def __enter__(self) -> "Source":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Frame]:
        while (frame := self.read()) is not None:
            yield frame

    def read(self) -> Frame | None:
        """The next frame (height, width), None at the end."""
        if self._first is not None:
            first, self._first = self._first, None
            return first
        ok, frame = self._capture.read()
        self.stamp_s = self._stamp_s()
        return mono8(frame, self.name) if ok and frame is not None else None

    def _stamp_s(self) -> float:
        return float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3

    def close(self) -> None:
        """Release the file or device."""
        self._capture.release()


def mono8(frame: NDArray[np.generic], where: str) -> Frame:
    """A decoded frame as mono8 (height, width); colour is averaged to grey. Raises InputError on other depths."""
    if frame.dtype != np.uint8 or frame.ndim not in (2, 3):
        raise InputError(f"{where}: frames of type {frame.dtype}, shape {frame.shape}; 8-bit grey or colour is needed")
    if frame.ndim == 3 and frame.shape[2] == 3:
        return np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))
    return np.asarray(frame if frame.ndim == 2 else frame[:, :, 0])


def _quietly_open(video: str | int) -> cv2.VideoCapture:
    """Open without the backends' own messages about a bad file, which repeat the InputError."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        return cv2.VideoCapture(video)
    finally:
        cv2.utils.logging.setLogLevel(level)
