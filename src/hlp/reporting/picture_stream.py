"""A page on this machine that shows pictures as they come (MJPEG)."""

import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from hlp.errors import InputError

HOST = "127.0.0.1"
_BOUNDARY = "picture"
_CLIENTS = 16  # at once
_INTERVAL = 0.01  # s between two looks for another picture
_PATIENCE = 10.0  # s, with a client that neither asks nor reads
_PAGE = b"""<!doctype html><html lang="en"><meta charset="utf-8"><title>hlp live</title>
<style>body{margin:0;background:#111}img{max-width:100vw;max-height:100vh}</style>
<img src="stream" alt="The last image with the poses that were found"></html>
"""


class PictureStream:
    """Serves the last picture on `http://127.0.0.1:PORT` until it is closed.

    `/` is a page, `/stream` the pictures as they come, `/picture.jpg` the last one. Nobody outside
    of this machine can reach it, nor can other sites' pages in its browsers. Raises InputError if
    the port is taken; port 0 takes a free one.
    """

    def __init__(self, port: int) -> None:
        self._shown: tuple[bytes, int] = b"", 0
        self._closed = False
        try:
            self._server = _Server((HOST, port), _Handler)
        except (OSError, OverflowError) as error:
            raise InputError(f"page={port}: {error}: give another port") from error
        self._server.stream = self
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self._server.server_address[1]}/"

    def show(self, jpeg: bytes) -> None:
        """Replace the picture."""
        self._shown = jpeg, self._shown[1] + 1

    def next(self, after: int) -> tuple[bytes, int]:
        """The first picture after the one of a number, and its number; no bytes at the end."""
        while True:
            closed, (picture, number) = self._closed, self._shown
            if number > after or closed:
                return (picture if number > after else b""), number
            time.sleep(_INTERVAL)

    def close(self) -> None:
        """Stop serving."""
        self._closed = True
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    request_queue_size = _CLIENTS
    stream: PictureStream

    def __init__(self, *given: Any) -> None:
        self._free = threading.Semaphore(_CLIENTS)
        super().__init__(*given)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread of its own; hang up if there are too many."""
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """See `process_request`."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that hangs up is no error; a bug shows its traceback."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = _PATIENCE

    def do_GET(self) -> None:
        """Answer one request."""
        # Another name may be a stranger's that was made to lead here (DNS rebinding); another port
        # may be forwarded to ours.
        if self.headers.get("Host", "").split(":")[0] not in (HOST, "localhost"):
            self.send_error(403, f"ask for {HOST}")
        elif self.path == "/":
            self._send("text/html", _PAGE)
        elif self.path == "/picture.jpg":
            self._send("image/jpeg", self.server.stream.next(0)[0])
        elif self.path == "/stream":
            self._stream()
        else:
            self.send_error(404)

    def end_headers(self) -> None:
        """Other pages may not show the pictures."""
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        super().end_headers()

    def log_message(self, *args: Any) -> None:
        """Requests are nobody's concern."""

    def _send(self, kind: str, content: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def _stream(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={_BOUNDARY}")
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        picture, number = self.server.stream.next(0)
        while picture:
            head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\n"
            head += f"Content-Length: {len(picture)}\r\n\r\n"
            self.wfile.write(head.encode() + picture + b"\r\n")
            picture, number = self.server.stream.next(number)
