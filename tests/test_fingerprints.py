"""Checksums of files, seals of records, and digests of the source of a small package."""

import copy
import json
import os
import sys

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bad_input import written
from generated_values import json_values, texts
from hlp import fingerprints
from hlp.errors import DataError
from hlp.fingerprints import (
    code_of,
    content_checksum,
    file_checksum,
    find_damaged,
    folder_checksums,
    seal_is_whole,
    sealed,
    source_digest,
)


def test_file_and_content_have_one_checksum_that_of_xxh3_128(tmp_path):
    """The value is one of xxHash's own test suite: the empty input with seed 0."""
    for content in (b"", os.urandom(1_000_003)):
        (tmp_path / "file").write_bytes(content)
        assert file_checksum(tmp_path / "file") == content_checksum(content)
    assert content_checksum(b"") == "99aa06d3014798d86001c324468d497f"


def test_every_changed_byte_is_found(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "file").write_bytes(bytes(range(64)))
    (tmp_path / "other").touch()
    (tmp_path / ".hidden").touch()
    checksums = folder_checksums(tmp_path, leaving_out=("other",))
    assert list(checksums) == ["sub/file"]
    assert list(find_damaged(tmp_path, checksums)) == []
    for at in range(64):
        changed = bytearray(range(64))
        changed[at] ^= 1
        (tmp_path / "sub" / "file").write_bytes(changed)
        assert list(find_damaged(tmp_path, checksums)) == ["sub/file"]
    (tmp_path / "sub" / "file").unlink()
    assert list(find_damaged(tmp_path, checksums)) == ["sub/file"]


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "a/../../b"])
def test_no_file_outside_the_folder_is_read(tmp_path, name):
    with pytest.raises(DataError, match="outside"):
        list(find_damaged(tmp_path, {name: "0"}))


RECORDS = st.dictionaries(texts(), json_values(), max_size=5)


@given(RECORDS, texts(), json_values(), st.data())
def test_a_seal_is_whole_after_writing_and_reading_until_anything_changes(
    record, name, value, data
):
    assume("checksum" not in record and name != "checksum")
    whole = json.loads(json.dumps(sealed(record), indent=2))
    assert seal_is_whole(dict(reversed(whole.items())))
    assert not seal_is_whole(record) and not seal_is_whole([whole])
    changed = copy.deepcopy(whole)
    if name in changed and data.draw(st.booleans()):
        del changed[name]
    else:
        changed[name] = value
    same = json.dumps(changed, sort_keys=True) == json.dumps(whole, sort_keys=True)
    assert seal_is_whole(changed) == same


FILES = {
    "outside/__init__.py": "",
    "outside/encoder.py": "from outside.deep import layers\n",
    "outside/deep/__init__.py": "",
    "outside/deep/layers.py": "def size():\n    from . import sizes\n    return sizes.WIDTH\n",
    "outside/deep/sizes.py": "import numpy\nWIDTH = 3\n",
    "outside/other.py": "UNUSED = 1\n",
    "outside/uses_hlp.py": "from hlp.geometry import rigid\n",
    "outside/uses_folder.py": "import lying_beside\n",
    "lying_beside.py": "VALUE = 1\n",
}


@pytest.fixture
def package(tmp_path, monkeypatch):
    for name, text in FILES.items():
        written(tmp_path / name, text)
    monkeypatch.syspath_prepend(str(tmp_path))
    forget()
    yield tmp_path
    forget()
    assert not {"outside", "lying_beside"} & sys.modules.keys()  # read, never imported


def forget():
    """What is read once in a process is read again."""
    for function in vars(fingerprints).values():
        if hasattr(function, "cache_clear"):
            function.cache_clear()


def after(change, text, module):
    change.write_text(text)
    forget()
    return source_digest(module)


def test_an_edit_in_what_is_imported_changes_the_digest_and_any_other_does_not(package):
    first = source_digest("outside.encoder")
    assert len(first) == 16 and int(first, 16) >= 0
    other = package / "outside" / "other.py"
    assert after(other, "UNUSED = 2\n", "outside.encoder") == first
    # Imported by a relative import within a function, two files away.
    sizes = package / "outside" / "deep" / "sizes.py"
    edited = after(sizes, "import numpy\nWIDTH = 4\n", "outside.encoder")
    assert edited != first
    # What importing the module runs before it.
    init = package / "outside" / "deep" / "__init__.py"
    assert after(init, "import os\n", "outside.encoder") not in (first, edited)


def test_hlps_modules_count_by_source_for_a_plug_in(package, monkeypatch):
    first = source_digest("outside.uses_hlp")
    read = fingerprints._read

    def edited(name):
        content = read(name)
        return content + b"\n" if name == "hlp.geometry" and content else content

    monkeypatch.setattr(fingerprints, "_read", edited)
    source_digest.cache_clear()
    assert source_digest("outside.uses_hlp") != first


def test_a_module_that_was_never_installed_counts_by_source_too(package):
    first = code_of("outside.uses_folder")
    assert set(first.libraries) == {"python"}
    beside = package / "lying_beside.py"
    assert after(beside, "VALUE = 2\n", "outside.uses_folder") != first.source


def test_libraries_count_by_their_version(package):
    import numpy

    found = code_of("outside.encoder").libraries
    assert found == {"python": ".".join(map(str, sys.version_info[:2])), "numpy": numpy.__version__}
    # LLVM makes numba's machine code, though HLP imports numba alone.
    assert {"numba", "llvmlite"} <= code_of("hlp.rendering.zbuffer").libraries.keys()


def test_several_modules_are_one_code_in_any_order(package):
    both = source_digest("outside.encoder", "outside.other")
    assert both == source_digest("outside.other", "outside.encoder")
    assert both not in (source_digest("outside.encoder"), source_digest("outside.other"))


@pytest.mark.parametrize("name", ["outside.gone", "nowhere.at_all"])
def test_a_module_without_source_is_named(package, name):
    with pytest.raises(ModuleNotFoundError, match=name):
        code_of(name)
