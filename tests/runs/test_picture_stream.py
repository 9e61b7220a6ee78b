import http.client
import socket
import threading
import time
import urllib.request

import pytest

from hlp.errors import InputError
from hlp.runs.live import PictureStream


def test_the_page_shows_pictures_as_they_come() -> None:
    stream = PictureStream(0)
    try:
        assert stream.address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(stream.address) as page:  # noqa: S310
            assert b'<img src="stream"' in page.read()
        stream.show(b"first")
        with urllib.request.urlopen(stream.address + "picture.jpg") as page:  # noqa: S310
            assert page.read() == b"first"
        with urllib.request.urlopen(stream.address + "stream") as shown:  # noqa: S310
            assert "multipart/x-mixed-replace" in shown.headers["Content-Type"]
            part = b"".join(shown.readline() for _ in range(4)) + shown.read(5)
            assert part.endswith(b"Content-Length: 5\r\n\r\nfirst")
            stream.show(b"second")
            part = b"".join(shown.readline() for _ in range(5)) + shown.read(6)
            assert part.endswith(b"second")
            stream.close()
            assert shown.read() == b"\r\n"  # the end
    finally:
        stream.close()


def test_a_taken_port_is_named() -> None:
    stream = PictureStream(0)
    try:
        port = int(stream.address.rsplit(":", 1)[1].strip("/"))
        with pytest.raises(InputError, match=f"page={port}: .*give another port"):
            PictureStream(port)
    finally:
        stream.close()
    with pytest.raises(InputError, match="page=99999"):
        PictureStream(99999)


def test_only_pages_of_this_machine_get_pictures(capsys: pytest.CaptureFixture[str]) -> None:
    stream = PictureStream(0)
    stream.show(b"first")
    port = int(stream.address.rsplit(":", 1)[1].strip("/"))
    try:
        for host, more, status in (
            ("evil.example", {}, 403),
            (f"evil.example:{port}", {}, 403),
            ("", {}, 403),
            ("localhost:9", {}, 200),  # forwarded
            ("localhost:9", {"Origin": "http://localhost:9"}, 200),
            ("localhost:9", {"Origin": "http://localhost:8"}, 403),
            ("127.0.0.1", {"Origin": "https://evil.example"}, 403),
            ("127.0.0.1", {"Origin": "null"}, 403),
            ("127.0.0.1", {"Sec-Fetch-Site": "same-origin"}, 200),
            ("127.0.0.1", {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Dest": "document"}, 200),
            ("127.0.0.1", {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Dest": "image"}, 403),
            ("127.0.0.1", {"Sec-Fetch-Site": "same-site", "Sec-Fetch-Dest": "iframe"}, 403),
        ):
            asked = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
            asked.request("GET", "/picture.jpg", headers={"Host": host} | more)
            answer = asked.getresponse()
            assert answer.status == status and (answer.read() == b"first") == (status == 200)
            assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"
            asked.close()
        before = threading.active_count()
        idle = [socket.create_connection(("127.0.0.1", port)) for _ in range(30)]
        assert all(client.recv(1) == b"" for client in idle[16:])
        assert threading.active_count() <= before + 16
        for client in idle:
            client.close()
    finally:
        stream.close()
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("shown", [False, True])
def test_clients_that_have_gone_leave_room_before_the_next_picture(shown: bool) -> None:
    stream = PictureStream(0)
    if shown:
        stream.show(b"first")
    port = int(stream.address.rsplit(":", 1)[1].strip("/"))
    try:
        for path in ("/stream", "/picture.jpg") * 20:
            with socket.create_connection(("127.0.0.1", port)) as client:
                client.sendall(f"GET {path} HTTP/1.0\r\nHost: localhost\r\n\r\n".encode())
                seen = b"first" if shown else b"\r\n\r\n" if path == "/stream" else b""
                received = b""
                while seen not in received:
                    received += client.recv(999)
            time.sleep(0.05)
        with urllib.request.urlopen(stream.address) as page:  # noqa: S310
            assert b'<img src="stream"' in page.read()
    finally:
        stream.close()
