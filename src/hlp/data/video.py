"""Frames of a video file, read one after another."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from hlp.errors import DataError


class VideoFrames:
    """Colour images of a video by index. Reading in order is fast; going back starts anew.

    Not for several threads at once. Seeking is avoided: with many codecs it is some frames off.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._capture: cv2.VideoCapture | None = None
        self._next = 0

    def read(self, index: int) -> UInt8[np.ndarray, "h w 3"]:
        """The frame of an index, as RGB. Raises DataError where the video has no such frame."""
        if self._capture is None or index < self._next:
            self.close()
            self._capture = _opened(self._path)
        while self._next < index and self._capture.grab():
            self._next += 1
        good, image = self._capture.read()
        if self._next != index or not good:
            self.close()
            raise DataError(f"{self._path}: frame {index} cannot be read: the video is cut off")
        self._next += 1
        return np.ascontiguousarray(image[..., ::-1])

    def close(self) -> None:
        """Free the file."""
        if self._capture is not None:
            self._capture.release()
        self._capture, self._next = None, 0


def count_video_frames(path: Path) -> int:
    """Number of frames, counted: what files state is often wrong. Raises DataError if it is none.

    Nothing is decoded into pictures, so that a minute of video takes about a second.
    """
    capture = _opened(path)
    count = 0
    while capture.grab():
        count += 1
    capture.release()
    return count


def _opened(path: Path) -> cv2.VideoCapture:
    capture = cv2.VideoCapture(str(path))
    if not capture.isOpened():
        raise DataError(f"{path} is truncated or no video that OpenCV can read")
    return capture
