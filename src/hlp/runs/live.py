"""`hlp live`: an answer to each image of a camera as it comes, as a line of JSON; its page."""

import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np

from hlp.data.cameras import BrokenImage, Camera
from hlp.errors import HlpError, InputError
from hlp.method.detector import Detector
from hlp.method.find.detections import Detection
from hlp.method.settings import TrackingSettings
from hlp.method.tracker import Tracker
from hlp.records import CameraImage, Frame, ObjectModel
from hlp.rendering.rasterizer import render_rgbd
from hlp.rendering.shading import FRONTAL_LIGHT
from hlp.runs.prediction import detection_values
from hlp.settings import Count, Doc

HOST = "127.0.0.1"
_PATIENCE = 10.0  # s, with a client that neither asks nor reads
_CLIENTS = 16  # at once
_QUALITY = 95  # of a JPEG
_PAGE = b"""<!doctype html><html lang="en"><meta charset="utf-8"><title>hlp live</title>
<style>body{margin:0;background:#111}img{max-width:100vw;max-height:100vh}</style>
<img alt="The last image with the poses that were found"><script>
const image = document.querySelector("img");
const show = () => { image.src = "picture.jpg?" + Date.now(); };
image.onload = () => setTimeout(show, 30);
image.onerror = () => setTimeout(show, 500);
show();
</script></html>
"""


class PicturePage(ThreadingHTTPServer):
    """Serves the last picture on `http://127.0.0.1:PORT` until it is closed.

    `/` is a page that asks for `/picture.jpg` again and again. Nobody outside of this machine can
    reach it, nor can other sites' pages in its browsers. Raises InputError if the port is taken;
    port 0 takes a free one.
    """

    daemon_threads = True
    request_queue_size = _CLIENTS
    picture = b""

    def __init__(self, port: int) -> None:
        self._free = threading.Semaphore(_CLIENTS)
        try:
            super().__init__((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            raise InputError(f"page={port}: {error}: give another port") from error
        self.address = f"http://{HOST}:{self.server_address[1]}/"
        """Address of the page."""
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def close(self) -> None:
        """Stop serving."""
        self.shutdown()
        self.server_close()

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Whether there is room for one more; else the server hangs up."""
        return self._free.acquire(blocking=False)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, in a thread of its own; a client that is slow on purpose is cut off."""
        end = threading.Timer(_PATIENCE, request.shutdown, [socket.SHUT_RDWR])
        end.daemon = True
        end.start()
        try:
            super().process_request_thread(request, client_address)
        finally:
            end.cancel()
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that hangs up is no error; a bug shows its traceback."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: PicturePage
    timeout = _PATIENCE

    def do_GET(self) -> None:
        """Answer one request."""
        pages = {"/": ("text/html", _PAGE), "/picture.jpg": ("image/jpeg", self.server.picture)}
        kind, content = pages.get(self.path.partition("?")[0], ("", b""))
        if not self._is_own():
            self.send_error(403, f"ask for {HOST}")
        elif not content:
            self.send_error(404)
        else:
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(content)

    def _is_own(self) -> bool:
        """Whether no other site's page embeds this, or has made its name lead here (DNS rebinding).

        A link may lead here, and another port may be forwarded to ours.
        """
        said, host = self.headers, self.headers.get("Host", "")
        linked = said.get("Sec-Fetch-Dest") == "document"
        own = said.get("Origin", f"//{host}").partition("//")[2] == host
        own &= linked or said.get("Sec-Fetch-Site", "none") in ("none", "same-origin")
        return own and host.split(":")[0] in (HOST, "localhost")

    def end_headers(self) -> None:
        """Other sites' pages may not show the pictures."""
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        super().end_headers()

    def log_message(self, *args: Any) -> None:
        """Requests are nobody's concern."""


_REHEARSAL_CAMERA = np.array([[600.0, 0.0, 319.5], [0.0, 600.0, 239.5], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, kw_only=True)
class LiveOptions(TrackingSettings):
    """What is looked for in the images of a camera, and how it is tracked."""

    objects: Annotated[list[str] | None, Doc("names; null: all learnt ones")] = None
    max_instances: Annotated[Count, Doc("of each object")] = 1


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
        self._page = None if page is None else PicturePage(page)
        self.address = None if self._page is None else self._page.address
        """Address of the page."""
        self._waiting: deque[tuple[CameraImage, Sequence[Detection]]] = deque(maxlen=1)
        self._drawer = ThreadPoolExecutor(1)
        self._drawn = self._drawer.submit(self._draw_last)

    def show(self, image: CameraImage, found: Sequence[Detection]) -> None:
        """Draw an image soon. Raises OSError if the picture before could not be written."""
        if self._drawn.done():
            self._drawn.result()
        self._waiting.append((image, found))
        self._drawn = self._drawer.submit(self._draw_last)

    def close(self) -> None:
        """Draw what is waiting, then stop."""
        self._drawer.shutdown()
        if self._page is not None:
            self._page.close()

    def _draw_last(self) -> None:
        if not self._waiting:  # the call before has drawn it
            return
        from hlp.reporting.figures.panels import draw_detections, write_picture  # needed by few

        image, found = self._waiting.pop()
        frame = Frame(0, 0, image.rgb, image.depth, image.camera_matrix)
        poses = [(self._models[answer.object], answer.pose_cam_obj) for answer in found]
        picture = draw_detections(frame, poses)
        if self._page is not None:
            bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
            self._page.picture = cv2.imencode(".jpg", bgr)[1].tobytes()
        if self._overlay is not None:
            write_picture(self._overlay, picture, _QUALITY)


def live(
    detector: Detector,
    camera: Camera,
    options: LiveOptions,
    answer: Callable[[Mapping[str, Any]], None],
    pictures: LivePictures | None = None,
) -> None:
    """Answer each image of a camera until it ends.

    The first line says that everything is loaded. Only an image that cannot be used is lost:
    its line has an `error`. The lines' fields are described in docs/live.md.
    """
    tracker = detector.tracker(options.objects, options.max_instances, options)
    _rehearse(detector, tracker)
    answer({"ready": True, "objects": list(options.objects or detector.objects)})
    for number, image in enumerate(camera):
        begun, about = time.perf_counter(), {"image": number, "name": image.name}
        try:
            if isinstance(image, BrokenImage):
                raise image.error
            result = tracker.search(image)
        except HlpError as error:
            answer({**about, "error": str(error)})
            continue
        ms = round((time.perf_counter() - begun) * 1000.0, 2)
        found = [{"object": each.object, **detection_values(each)} for each in result.detections]
        missing = [{"object": each.object, "reason": each.reason} for each in result.rejections]
        answer({**about, "captured": image.captured, "ms": ms, "found": found, "missing": missing})
        if pictures is not None:
            pictures.show(image, result.detections)


def _rehearse(detector: Detector, tracker: Tracker) -> None:
    """Search and track once in a rendered image, so that the first real one takes no longer."""
    detector.warm_up()
    model = next(iter(detector.models.values()))
    pose = np.eye(4)
    pose[:3, 3] = np.array([0.0, 0.0, 4.0 * model.diameter]) - model.centroid
    rgb, depth = render_rgbd(model.mesh, pose, _REHEARSAL_CAMERA, (480, 640), FRONTAL_LIGHT)
    wall = np.where(depth > 0.0, depth, 6.0 * model.diameter).astype(np.float32)
    for _ in range(2):
        tracker.search(CameraImage(rgb, wall, _REHEARSAL_CAMERA))
    tracker.reset()
