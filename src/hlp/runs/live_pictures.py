"""Pictures of the poses of `hlp live`, drawn beside tracking: a file, a page, or both."""

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from hlp.errors import InputError
from hlp.files import replaced
from hlp.method.find.detections import Detection
from hlp.records import CameraImage, Frame, ObjectModel
from hlp.reporting.picture_stream import PictureStream

_Shown = tuple[CameraImage, Sequence[Detection]]


class LivePictures:
    """Draws the last image with its poses in a thread of its own; images in between are left out.

    `overlay` is a PNG or JPEG file that is replaced by each picture, `page` the port of a page.
    """

    def __init__(
        self, models: Mapping[str, ObjectModel], overlay: Path | None, page: int | None
    ) -> None:
        if overlay is not None and overlay.suffix.lower() not in {".png", ".jpg", ".jpeg"}:
            raise InputError(f"overlay={overlay}: it must be a .png or .jpg file")
        self._models, self._overlay = models, overlay
        self._stream = None if page is None else PictureStream(page)
        self._changed, self._closed = threading.Condition(), False
        self._waiting: _Shown | None = None
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._draw_all, daemon=True)
        self._thread.start()

    @property
    def address(self) -> str | None:
        """Address of the page."""
        return None if self._stream is None else self._stream.address

    def show(self, image: CameraImage, found: Sequence[Detection]) -> None:
        """Draw an image soon. Raises OSError if the picture before could not be written."""
        with self._changed:
            if self._error is not None:
                raise self._error
            self._waiting = image, found
            self._changed.notify()

    def close(self) -> None:
        """Draw what is waiting, then stop."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()
        if self._stream is not None:
            self._stream.close()

    def _draw_all(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._waiting is not None)
                shown, self._waiting = self._waiting, None
            if shown is None:
                return
            try:
                self._draw(*shown)
            except OSError as error:
                self._error = error
                return

    def _draw(self, image: CameraImage, found: Sequence[Detection]) -> None:
        from hlp.reporting.figures.panels import draw_detections  # needed by few

        frame = Frame(0, 0, image.rgb, image.depth, image.camera_matrix)
        poses = [(self._models[each.object], each.pose_cam_obj) for each in found]
        picture = cv2.cvtColor(draw_detections(frame, poses), cv2.COLOR_RGB2BGR)
        if self._stream is not None:
            self._stream.show(_encoded(picture, ".jpg"))
        if self._overlay is not None:
            content = _encoded(picture, self._overlay.suffix)
            with replaced(self._overlay) as stream:
                stream.write(content)


def _encoded(picture: np.ndarray, kind: str) -> bytes:
    return cv2.imencode(kind, picture)[1].tobytes()
