"""Public data sets from a local server: folders that HLP's readers take."""

import hashlib
import io
import json
import shutil
import socket
import time
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import httpx2
import numpy as np
import pytest
from filelock import FileLock

from bop_folder import write_models, write_scene, write_targets
from hlp.cli import main
from hlp.data.bop import BopSettings
from hlp.data.download import SOURCES, download, fetch
from hlp.data.public_sets import SETS, Archive, find_set
from hlp.errors import DataError, DiskFullError, InputError, NetworkError
from http_file_server import Served, serving

PATH = "lm/resolve/main"
CONTENT = np.random.default_rng(0).bytes(3_000_000)
SHA256 = hashlib.sha256(CONTENT).hexdigest()
MD5 = hashlib.md5(CONTENT, usedforsecurity=False).hexdigest()


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    monkeypatch.setattr(time, "sleep", lambda _: None)
    monkeypatch.setattr("huggingface_hub.constants.DOWNLOAD_CHUNK_SIZE", 1 << 16)


@pytest.fixture
def server():
    with serving(Served({"a.zip": CONTENT})) as served:
        yield served


def archive(served, **known):
    return Archive(f"{served.address}/a.zip", **known)


def test_a_whole_file_is_loaded_once(server, tmp_path, caplog):
    caplog.set_level("INFO", "hlp")
    about = {"url": archive(server).url, "bytes": len(CONTENT), "sha256": SHA256}
    for _ in range(2):
        assert fetch(archive(server), tmp_path / "a.zip") == about
    assert (tmp_path / "a.zip").read_bytes() == CONTENT
    assert server.asked == [("a.zip", 0)]
    assert [path.name for path in tmp_path.iterdir()] == ["a.zip"]
    assert "verified: size alone" in caplog.text


@pytest.mark.parametrize("hub", [False, True])
@pytest.mark.parametrize("ranges", [False, True])
def test_a_cut_is_continued_where_it_happened(server, tmp_path, hub, ranges, caplog):
    caplog.set_level("INFO", "hlp")
    server.cuts, server.hub, server.ranges = [1_500_000, 700_000], hub, ranges
    fetch(archive(server), tmp_path / "a.zip")
    assert (tmp_path / "a.zip").read_bytes() == CONTENT
    begins = [begin for _, begin in server.asked]
    assert begins[0] == 0 and 0 < begins[1] <= 1_500_000
    assert ("sha256 of the server" if hub else "size alone") in caplog.text


def test_another_call_continues_what_is_left_of_the_same_version(server, tmp_path):
    server.cuts, server.statuses = [1_500_000], [200, 200, 503]
    with pytest.raises(NetworkError, match=r"503.*MB are kept in .*a\.zip\.v1\.part: .*continue"):
        fetch(archive(server), tmp_path / "a.zip")
    kept = (tmp_path / "a.zip.v1.part").stat().st_size
    assert kept > 1_000_000 and not (tmp_path / "a.zip").exists()
    fetch(archive(server), tmp_path / "a.zip")
    assert server.asked[-1] == ("a.zip", kept)
    (tmp_path / "b.zip.v1.part").write_bytes(b"another version" * 1000)
    server.etag = "v2"
    fetch(archive(server), tmp_path / "b.zip")
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes() == CONTENT
    server.etag = None  # then no part is known to be of this version
    (tmp_path / "c.zip..part").write_bytes(b"another version" * 1000)
    fetch(archive(server), tmp_path / "c.zip")
    assert (tmp_path / "c.zip").read_bytes() == CONTENT
    (tmp_path / f"d.zip.md5{MD5}.part").write_bytes(CONTENT[:99])  # its checksum tells it
    fetch(archive(server, checksum=f"md5:{MD5}"), tmp_path / "d.zip")
    assert server.asked[-1] == ("a.zip", 99)
    (tmp_path / f"e.zip.md5{MD5}.part").write_bytes(CONTENT + b"more")  # then it is loaded anew
    with pytest.raises(NetworkError, match="nothing is loaded yet"):
        fetch(archive(server, checksum=f"md5:{MD5}"), tmp_path / "e.zip")
    assert not list(tmp_path.glob("e.zip*"))


def test_checksums_are_compared(server, tmp_path, caplog):
    caplog.set_level("INFO", "hlp")
    with pytest.raises(DataError, match=f"its md5 is {MD5}, not 00"):
        fetch(archive(server, checksum=f"md5:{'0' * 32}"), tmp_path / "a.zip")
    assert not list(tmp_path.iterdir())
    fetch(archive(server, checksum=f"md5:{MD5}"), tmp_path / "a.zip")
    server.hub = True
    fetch(archive(server, checksum=f"md5:{MD5}"), tmp_path / "f.zip")
    fetch(archive(server, checksum=f"sha256:{SHA256}"), tmp_path / "b.zip")
    assert "verified: md5 known" in caplog.text and "verified: sha256 known\n" in caplog.text
    server.sha256 = "1" * 64
    with pytest.raises(DataError, match=f"its sha256 is {SHA256}, not 1111"):
        fetch(archive(server), tmp_path / "c.zip")
    with pytest.raises(DataError, match="is not the file that it should be: it"):
        fetch(archive(server, checksum=f"sha256:{SHA256}"), tmp_path / "d.zip")
    server.hub, server.etag = False, "1" * 64  # of another server, it is no checksum
    fetch(archive(server), tmp_path / "e.zip")


def test_what_keeps_a_file_from_being_loaded_is_named(server, tmp_path, monkeypatch):
    with pytest.raises(NetworkError, match=r"404.*nothing is loaded yet"):
        fetch(Archive(f"{server.address}/none.zip"), tmp_path / "a.zip")
    with serving(Served({})) as gone:
        pass
    with pytest.raises(NetworkError, match=r"127\.0\.0\.1.*nothing is loaded yet"):
        fetch(archive(gone), tmp_path / "a.zip")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=51_000_000))
    with pytest.raises(DiskFullError, match=r"0\.1 GB free.*output=FOLDER"):
        fetch(archive(server), tmp_path / "a.zip")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "[::1]", "169.254.169.254", "10.0.0.1"])
@pytest.mark.parametrize("asked", ["https://files.example/a.zip", "http://93.184.216.34/a.zip"])
def test_no_redirect_leads_into_the_users_own_network(monkeypatch, tmp_path, host, asked):
    answer = httpx2.Response(302, headers={"Location": f"http://{host}"})
    resolve = socket.getaddrinfo
    names = {"files.example": "1.1.1.1"}
    monkeypatch.setattr(
        socket, "getaddrinfo", lambda name, *of: resolve(names.get(name, name), *of)
    )
    monkeypatch.setattr(httpx2.HTTPTransport, "handle_request", lambda *_: answer)
    with pytest.raises(DataError, match=r"leads to .*, which is not in the internet"):
        fetch(Archive(asked), tmp_path / "a.zip")
    assert not [path for path in tmp_path.iterdir() if path.stat().st_size]


def zipped(root: Path, around: str = "") -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as packed:
        for path in sorted(path for path in root.rglob("*") if path.is_file()):
            packed.write(path, around + path.relative_to(root).as_posix())
    return content.getvalue()


@pytest.fixture
def hub(tmp_path):
    """BOP's three archives of `lm`, of a small data set."""
    base, models, test = (tmp_path / name for name in ("base", "models", "test"))
    base.mkdir()
    write_targets(base / "test_targets_bop19.json", [(6, 0, 1, 1), (6, 0, 6, 2)])
    write_models(models / "models", (1, 6))
    write_scene(test / "test")
    archives = {"base": zipped(base, "lm/"), "models": zipped(models), "test_bop19": zipped(test)}
    files = {f"{PATH}/lm_{name}.zip": content for name, content in archives.items()}
    with serving(Served(files, hub=True)) as served:
        yield served


@pytest.mark.usefixtures("no_near_symmetries")
def test_the_result_is_a_bop_set(hub, tmp_path, capsys):
    folder = tmp_path / "sets" / "lm"
    main(["download", "lm", f"output={folder}", f"mirror={hub.address}/"])
    said = capsys.readouterr().out
    assert said.index("licence") < said.index("lm_base.zip (0.0 MB)") < said.index("0.0 GB until")
    assert said.index("0.0 GB until") < said.index("lm_base.zip: ") < said.index("Next:")
    assert f"Next: hlp run data=bop data.root={folder} data.split=test" in said
    frames = BopSettings(root=str(folder)).build().frames
    assert frames.keys == ("000006_000000",)
    assert [target.object_id for target in frames.load(frames.keys[0]).targets] == [1, 6, 6]
    sources = json.loads((folder / SOURCES).read_text())
    assert {source["url"].removeprefix(f"{hub.address}/"): source["sha256"] for source in
            sources["archives"]} == {
        name: hashlib.sha256(content).hexdigest() for name, content in hub.files.items()
    }  # fmt: skip
    assert [path.name for path in folder.parent.iterdir()] == ["lm"]


@pytest.mark.parametrize("name", ["lmo", "tless", "tudl", "icbin", "itodd", "hb", "ycbv"])
def test_each_core_set_is_loaded_by_its_archives_names(hub, tmp_path, name):
    sensor = "_primesense" if name in ("tless", "hb") else ""
    parts = {"base": "base", "models": "models", "test_bop19": f"test{sensor}_bop19"}
    hub.files = {
        f"{name}/resolve/main/{name}_{parts[part]}.zip": hub.files[f"{PATH}/lm_{part}.zip"]
        for part in parts
    }
    public = replace(find_set(name), name="lm")  # the archives' own folder
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("hlp.data.public_sets.KNOWN", {})
        folder = download(public, tmp_path / name, "bop19", hub.address)
    assert {path.name for path in folder.iterdir()} == {
        "models", "test", "test_targets_bop19.json", SOURCES,
    }  # fmt: skip


def test_nothing_is_loaded_if_an_archive_is_absent_or_the_disk_is_short(hub, tmp_path, monkeypatch):
    with monkeypatch.context() as patched, pytest.raises(DiskFullError, match="packed and unpack"):
        patched.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=50_000_100))
        download(find_set("lm"), tmp_path / "lm", "bop19", hub.address)
    hub.files.pop(f"{PATH}/lm_test_bop19.zip")
    with pytest.raises(NetworkError, match="404"):
        download(find_set("lm"), tmp_path / "lm", "bop19", hub.address)
    assert not hub.asked and not (tmp_path / ".lm.partial").exists()


def test_a_call_after_an_interruption_continues(hub, tmp_path):
    folder = tmp_path / "lm"
    hub.statuses = [200] * 7 + [404]  # three files asked for, two loaded
    with pytest.raises(NetworkError, match="404"):
        download(find_set("lm"), folder, "bop19", hub.address)
    assert not folder.exists()
    with FileLock(tmp_path / ".lm.lock"), pytest.raises(InputError, match="another process"):
        download(find_set("lm"), folder, "bop19", hub.address)
    download(find_set("lm"), folder, "bop19", hub.address)
    assert [name for name, _ in hub.asked] == ["lm_base.zip", "lm_models.zip", "lm_test_bop19.zip"]
    with pytest.raises(InputError, match="exists already"):
        download(find_set("lm"), folder, "bop19", hub.address)


def test_a_hostile_archive_leaves_no_folder(hub, tmp_path):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as packed:
        packed.writestr("../../out.txt", "out")
    hub.files[f"{PATH}/lm_models.zip"] = content.getvalue()
    with pytest.raises(DataError, match=r"lm_models\.zip: its member .* leads out"):
        download(find_set("lm"), tmp_path / "lm", "bop19", hub.address)
    assert not (tmp_path / "lm").exists() and not list(tmp_path.rglob("out.txt"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing"], "there is no data set 'nothing': choose from lmo, tless"),
        (["images=all", "lm"], "the name of a data set comes first"),
        (["lm", "images=few"], "images=few: lm has bop19, all"),
        (["voc2012", "images=bop19"], "images=bop19: voc2012 has all"),
        (["lm", "folder=x"], "folder is not a key of `hlp download`"),
    ],
)
def test_wrong_arguments_are_one_line(arguments, message, fails):
    assert message in fails("download", *arguments)


def test_help_lists_all_sets_and_every_archive_has_an_address(capsys):
    main(["download", "--help"])
    shown = capsys.readouterr().out
    for public in SETS.values():
        assert public.what in shown
        for images in public.archives:
            for file in public.files(images):
                assert file.url.startswith(("https://huggingface.co/datasets/", "http://host."))
                kind, _, digits = (file.checksum or "md5:" + "0" * 32).partition(":")
                assert len(digits) == {"md5": 32, "sha256": 64}[kind]
