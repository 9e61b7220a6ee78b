import http.client
import socket
import threading
import time
import urllib.request
from contextlib import suppress

import pytest

from hlp.errors import InputError
from hlp.runs import live
from hlp.runs.live import PicturePage

OTHER_SITE = {"Sec-Fetch-Site": "cross-site"}


def test_the_page_shows_the_last_picture_to_this_machine_alone(capsys, monkeypatch):
    monkeypatch.setattr(live, "_PATIENCE", 1.0)
    page = PicturePage(0)
    port = page.server_address[1]
    try:
        assert page.address == f"http://127.0.0.1:{port}/"
        with urllib.request.urlopen(page.address) as shown:  # noqa: S310
            assert b"picture.jpg" in shown.read()
        for picture, host, more, status in (
            (b"", "localhost", {}, 404),
            (b"first", "localhost", {}, 200),
            (b"second", "127.0.0.1", {}, 200),
            (b"second", "localhost:9", {}, 200),  # forwarded
            (b"second", f"evil.example:{port}", {}, 403),
            (b"second", "", {}, 403),
            (b"second", "localhost:9", {"Origin": "http://localhost:9"}, 200),
            (b"second", "127.0.0.1", {"Origin": "https://evil.example"}, 403),
            (b"second", "127.0.0.1", {"Sec-Fetch-Site": "same-origin"}, 200),
            (b"second", "127.0.0.1", {**OTHER_SITE, "Sec-Fetch-Dest": "document"}, 200),
            (b"second", "127.0.0.1", {**OTHER_SITE, "Sec-Fetch-Dest": "image"}, 403),
        ):
            page.picture = picture
            asked = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
            asked.request("GET", "/picture.jpg?1", headers={"Host": host} | more)
            answer = asked.getresponse()
            assert answer.status == status and (answer.read() == picture) == (status == 200)
            assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"
            asked.close()
        before = threading.active_count()
        idle = [socket.create_connection(("127.0.0.1", port)) for _ in range(30)]
        assert all(client.recv(1) == b"" for client in idle[16:])
        assert threading.active_count() <= before + 2 * 16
        for _ in range(10):  # they send a line now and then
            with suppress(OSError):
                idle[0].sendall(b"GET / HTTP/1.1\r\n")
            time.sleep(0.2)
        assert idle[1].recv(1) == b""
        for client in idle:
            client.close()
        with pytest.raises(InputError, match=f"page={port}: .*give another port"):
            PicturePage(port)
    finally:
        page.close()
    with pytest.raises(InputError, match="page=99999"):
        PicturePage(99999)
    assert "Traceback" not in capsys.readouterr().err
