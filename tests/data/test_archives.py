import io
import shutil
import stat
import tarfile
import zipfile
from types import SimpleNamespace

import pytest

from hlp.data.download import unpack
from hlp.errors import DataError, DiskFullError

GOOD = {"models/a.ply": b"ply" * 1000, "test/000001/rgb/000000.png": b"png" * 2000, "x.json": b"{}"}
BAD_NAMES = ("/etc/passwd", "../out", "a/../../out", "C:/x", "a\\..\\..\\out", "\\\\host\\x", "..")


def zipped(path, files, **infos):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in files.items():
            packed.writestr(name, content)
        for name, mode in infos.items():
            info = zipfile.ZipInfo(name)
            info.external_attr = mode << 16
            packed.writestr(info, "../../out")
    return path


def taped(path, files, kind=tarfile.REGTYPE):
    with tarfile.open(path, "w") as tape:
        for name, content in files.items():
            info = tarfile.TarInfo(name)
            info.type = kind
            info.linkname = "../../out"
            info.size = len(content) if kind == tarfile.REGTYPE else 0
            tape.addfile(info, io.BytesIO(content))
    return path


@pytest.fixture
def folder(tmp_path):
    inner = tmp_path / "deep" / "er"
    inner.mkdir(parents=True)
    return inner


def content_of(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.parametrize("pack", [zipped, taped])
@pytest.mark.parametrize("around", ["", "lm/", "./"])
def test_files_are_unpacked_without_the_folder_around_them(tmp_path, folder, pack, around):
    archive = pack(tmp_path / "a", {f"{around}{name}": content for name, content in GOOD.items()})
    assert unpack(archive, folder, "lm") == 3
    assert content_of(folder) == GOOD


@pytest.mark.parametrize("pack", [zipped, taped])
@pytest.mark.parametrize("name", BAD_NAMES)
def test_nothing_leads_out_of_the_folder(tmp_path, folder, pack, name):
    archive = pack(tmp_path / "a", GOOD | {name: b"out"})
    with pytest.raises(DataError, match=r"a: its member .* leads out"):
        unpack(archive, folder, "lm")
    assert not content_of(folder) and not (tmp_path / "out").exists()


def test_links_and_devices_are_refused(tmp_path, folder):
    archive = zipped(tmp_path / "a", GOOD, link=stat.S_IFLNK | 0o777)
    with pytest.raises(DataError, match="'link' is encrypted, a link"):
        unpack(archive, folder, "lm")
    for kind in (tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.FIFOTYPE):
        with pytest.raises(DataError, match=r"'models/a\.ply' is encrypted, a link"):
            unpack(taped(tmp_path / "a", GOOD, kind), folder, "lm")
    assert not content_of(folder)


def test_bombs_and_full_disks_are_known_by_what_is_stated(tmp_path, folder, monkeypatch):
    archive = zipped(tmp_path / "a", {f"{i}": bytes(20_000_000) for i in range(3)})
    with pytest.raises(DataError, match="states 60000000 unpacked"):
        unpack(archive, folder, "lm")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=50_000_100))
    with pytest.raises(DiskFullError, match="output=FOLDER"):
        unpack(zipped(tmp_path / "b", GOOD), folder, "lm")
    assert not content_of(folder)


def test_a_member_larger_than_stated_is_an_error(tmp_path, folder):
    archive = zipped(tmp_path / "a", {"x": bytes(1000)})
    data = bytearray(archive.read_bytes())
    for signature, offset in ((b"PK\3\4", 22), (b"PK\1\2", 24)):
        at = data.index(signature) + offset
        data[at : at + 4] = (10).to_bytes(4, "little")
    archive.write_bytes(data)
    with pytest.raises(DataError):
        unpack(archive, folder, "lm")
    assert all(len(content) <= 10 for content in content_of(folder).values())


@pytest.mark.parametrize("pack", [zipped, taped])
def test_damage_is_named(tmp_path, folder, pack):
    archive = pack(tmp_path / "a", GOOD)
    whole = archive.read_bytes()
    damaged = [b"", b"<html>not found</html>" * 100, whole[: len(whole) // 3]]
    if pack is zipped:  # tar has no checksums of its content
        at = whole.index(b"models/a.ply") + 20
        damaged.append(whole[:at] + bytes([whole[at] ^ 255]) + whole[at + 1 :])
    damaged.append(pack(tmp_path / "b", {"x": b"", "x/y": b""}).read_bytes())
    for content in damaged:
        archive.write_bytes(content)
        with pytest.raises(DataError, match="a is damaged"):
            unpack(archive, folder, "lm")
