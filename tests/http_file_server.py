"""A local HTTP server of some files: it can cut connections, refuse ranges, and redirect."""

import hashlib
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


@dataclass
class Served:
    """What the server has, how it behaves, and the byte from which each file was asked for.

    `cuts` are numbers of bytes after which the next answers end; `hub` redirects as Hugging Face
    does, stating `sha256` (None: the true one). `statuses` are those of the next answers.
    """

    files: dict[str, bytes]
    ranges: bool = True
    cuts: list[int] = field(default_factory=list)
    hub: bool = False
    sha256: str | None = None
    etag: str | None = "v1"
    statuses: list[int] = field(default_factory=list)
    asked: list[tuple[str, int]] = field(default_factory=list)
    address: str = ""


@contextmanager
def serving(served: Served) -> Iterator[Served]:
    """Serve until the block ends; `address` is where."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            answer(self, served)

        do_HEAD = do_GET  # noqa: N815 - the name that http.server calls

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    served.address = f"http://127.0.0.1:{server.server_address[1]}"
    try:
        yield served
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def answer(request: BaseHTTPRequestHandler, served: Served) -> None:
    path = request.path.removeprefix("/cdn")
    status = served.statuses.pop(0) if served.statuses else 200
    if status != 200:
        request.send_error(status)
        return
    if path.strip("/") not in served.files:
        request.send_error(404)
        return
    content = served.files[path.strip("/")]
    if served.hub and not request.path.startswith("/cdn"):
        request.send_response(302)
        stated = served.sha256 or hashlib.sha256(content).hexdigest()
        request.send_header("X-Repo-Commit", "c0")
        request.send_header("X-Linked-ETag", f'"{stated}"')
        request.send_header("X-Linked-Size", str(len(content)))
        other_host = served.address.replace("127.0.0.1", "localhost")
        request.send_header("Location", f"{other_host}/cdn{path}")
        request.send_header("Content-Length", "0")
        request.end_headers()
        return
    begin = int(request.headers.get("Range", "bytes=0-")[6:-1])
    headers = {"ETag": f'"{served.etag}"'} if served.etag else {}
    if request.command == "HEAD":
        send(request, 200, headers, b"", len(content))
        return
    served.asked.append((path.rpartition("/")[2], begin))
    if begin >= len(content) and served.ranges:
        send(request, 416, headers | {"Content-Range": f"bytes */{len(content)}"}, b"", 0)
        return
    if "Range" in request.headers and served.ranges:
        headers["Content-Range"] = f"bytes {begin}-{len(content) - 1}/{len(content)}"
        status, body = 206, content[begin:]
    else:
        status, body = 200, content
    send(request, status, headers, body[: served.cuts.pop(0)] if served.cuts else body, len(body))


def send(
    request: BaseHTTPRequestHandler, status: int, headers: dict[str, str], body: bytes, length: int
) -> None:
    request.send_response(status)
    for name, value in headers.items():
        request.send_header(name, value)
    request.send_header("Content-Length", str(length))
    request.end_headers()
    with suppress(ConnectionError):  # clients that want no more
        request.wfile.write(body)
