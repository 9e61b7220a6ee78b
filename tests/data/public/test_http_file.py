import errno
import hashlib
import shutil
from collections import namedtuple

import numpy as np
import pytest

from hlp.data.public.http_file import fetch
from hlp.data.public.sets import Archive
from hlp.errors import DataError, DiskFullError, NetworkError, is_expected
from http_file_server import Served, serving

CONTENT = np.random.default_rng(0).bytes(3_000_000)
SHA256 = hashlib.sha256(CONTENT).hexdigest()
NO_WAITS = (0.0, 0.0)


@pytest.fixture
def server():
    with serving(Served({"a.zip": CONTENT})) as served:
        yield served


def archive(served, **known):
    return Archive(f"{served.address}/a.zip", **known)


def test_a_whole_file_is_loaded_once(server, tmp_path):
    loaded = fetch(archive(server), tmp_path / "a.zip")
    assert (tmp_path / "a.zip").read_bytes() == CONTENT
    assert (loaded.sha256, loaded.verified) == (SHA256, "size alone")
    assert fetch(archive(server), tmp_path / "a.zip").sha256 == SHA256
    assert server.asked == [("a.zip", 0)]
    assert [each.name for each in tmp_path.iterdir()] == ["a.zip"]


@pytest.mark.parametrize("hub", [False, True])
def test_a_cut_is_continued_where_it_happened(server, tmp_path, hub):
    server.cuts, server.hub = [1_500_000, 700_000], hub
    loaded = fetch(archive(server), tmp_path / "a.zip", waits=NO_WAITS)
    assert (tmp_path / "a.zip").read_bytes() == CONTENT
    begins = [begin for _, begin in server.asked]
    assert begins[0] == 0 and 0 < begins[1] <= 1_500_000 and begins[1] < begins[2] <= 2_200_000
    assert loaded.verified == ("sha256 of the server" if hub else "size alone")


def test_another_call_continues_what_is_left(server, tmp_path):
    server.cuts, server.statuses = [1_500_000], [200, 503, 503]
    with pytest.raises(NetworkError, match=r"MB are kept in .*a\.zip\.part: .*continue"):
        fetch(archive(server), tmp_path / "a.zip", waits=[0.0])
    kept = (tmp_path / "a.zip.part").stat().st_size
    assert kept > 1_000_000 and not (tmp_path / "a.zip").exists()
    fetch(archive(server), tmp_path / "a.zip")
    assert server.asked[-1] == ("a.zip", kept)
    assert (tmp_path / "a.zip").read_bytes() == CONTENT


def test_what_was_whole_but_not_verified_is_only_verified(server, tmp_path):
    server.cuts = [len(CONTENT)]
    fetch(archive(server), tmp_path / "b.zip")
    (tmp_path / "b.zip").rename(tmp_path / "a.zip.part")
    (tmp_path / "a.zip.part.json").write_text('{"version": "\\"v1\\""}')
    fetch(archive(server), tmp_path / "a.zip")
    assert (tmp_path / "a.zip").read_bytes() == CONTENT
    assert server.asked[1:] == [("a.zip", len(CONTENT))]


@pytest.mark.parametrize("notes", ['{"version": "\\"v0\\""}', "{}", "[", None])
def test_the_beginning_of_another_version_is_not_continued(server, tmp_path, notes):
    (tmp_path / "a.zip.part").write_bytes(b"other" * 1000)
    if notes is not None:
        (tmp_path / "a.zip.part.json").write_text(notes)
    fetch(archive(server), tmp_path / "a.zip")
    assert (tmp_path / "a.zip").read_bytes() == CONTENT
    assert server.asked[-1] == ("a.zip", 0)


def test_a_server_without_ranges_starts_over(server, tmp_path):
    server.ranges, server.cuts = False, [1_500_000]
    fetch(archive(server), tmp_path / "a.zip", waits=NO_WAITS)
    assert (tmp_path / "a.zip").read_bytes() == CONTENT


def test_a_server_that_always_cuts_is_given_up(server, tmp_path):
    server.ranges, server.cuts = False, [1_500_000] * 20
    with pytest.raises(NetworkError, match="kept"):
        fetch(archive(server), tmp_path / "a.zip", waits=NO_WAITS)
    assert 2 < len(server.asked) < 8


@pytest.mark.parametrize("version", ["v1", None])
def test_a_wrong_checksum_deletes_the_file(server, tmp_path, version):
    server.etag = version
    md5 = hashlib.md5(CONTENT, usedforsecurity=False).hexdigest()
    with pytest.raises(DataError, match=f"its md5 is {md5}, not 00"):
        fetch(archive(server, checksum=f"md5:{'0' * 32}"), tmp_path / "a.zip")
    assert not (tmp_path / "a.zip.part").exists() and not (tmp_path / "a.zip").exists()
    loaded = fetch(archive(server, checksum=f"md5:{md5}"), tmp_path / "a.zip")
    assert loaded.verified == "md5 known"


def test_what_the_hub_states_is_compared(server, tmp_path):
    server.hub = True
    loaded = fetch(archive(server, checksum=f"sha256:{SHA256}"), tmp_path / "a.zip")
    assert loaded.verified == "sha256 known"
    server.sha256 = "1" * 64
    with pytest.raises(DataError, match=f"its sha256 is {SHA256}, not 1111"):
        fetch(archive(server), tmp_path / "b.zip")


@pytest.mark.parametrize("known", [{"checksum": f"sha256:{SHA256}"}, {"size": 7}])
def test_another_file_than_the_known_one_is_not_loaded(server, tmp_path, known):
    server.hub, server.sha256 = True, "2" * 64
    with pytest.raises(DataError, match="was not loaded"):
        fetch(archive(server, **known), tmp_path / "a.zip")
    assert not list(tmp_path.iterdir())


def test_answers_that_are_no_file_are_named(server, tmp_path):
    with pytest.raises(NetworkError, match="answers 404"):
        fetch(Archive(f"{server.address}/none.zip"), tmp_path / "a.zip")
    server.statuses = [503, 429]
    fetch(archive(server), tmp_path / "a.zip", waits=NO_WAITS)
    server.statuses = [500] * 9
    with pytest.raises(NetworkError, match="answers 500"):
        fetch(archive(server), tmp_path / "b.zip", waits=NO_WAITS)


def test_no_network_is_said_at_once(tmp_path):
    with serving(Served({})) as gone:
        pass
    with pytest.raises(NetworkError, match=r"127\.0\.0\.1.*nothing is loaded yet") as caught:
        fetch(archive(gone), tmp_path / "a.zip", waits=(1e9,))
    assert is_expected(caught.value)


def test_a_full_disk_is_said_before_loading(server, tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(1, 1, 51_000_000))
    with pytest.raises(DiskFullError, match=r"0\.1 GB free.*output=FOLDER"):
        fetch(archive(server), tmp_path / "a.zip")
    assert not list(tmp_path.iterdir())
    assert is_expected(OSError(errno.ENOSPC, "full"))
