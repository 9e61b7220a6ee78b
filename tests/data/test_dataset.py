import os

import pytest

from hlp.data.dataset import annotated_mask, content_hash


@pytest.fixture
def files(tmp_path):
    paths = [tmp_path / "a", tmp_path / "b"]
    for path in paths:
        path.write_bytes(path.name.encode() * 100)
    return paths


def test_equal_content_has_one_identity_wherever_it_lies(files, tmp_path):
    before = content_hash(files)
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    for path in files:
        (moved / path.name).write_bytes(path.read_bytes())
        os.utime(moved / path.name, (0, 0))
    assert content_hash([moved / path.name for path in files]) == before
    assert len(before) == 32


def test_one_changed_byte_order_or_setting_changes_it(files):
    identities = {content_hash(files), content_hash(files[::-1]), content_hash(files, "x")}
    content = bytearray(files[0].read_bytes())
    content[50] ^= 1
    files[0].write_bytes(content)
    identities.add(content_hash(files))
    assert len(identities) == 4


def test_bytes_cannot_wander_from_one_file_to_the_next(files):
    before = content_hash(files)
    first, second = files
    content = first.read_bytes() + second.read_bytes()
    first.write_bytes(content[:150])
    second.write_bytes(content[150:])
    assert content_hash(files) != before


def test_the_mask_of_the_data_set_is_given_where_it_has_one():
    class Unannotated:
        pass

    class Annotated:
        def visible_mask(self, frame, target):
            return (frame, target)

    assert annotated_mask(Unannotated(), "frame", "target") is None
    assert annotated_mask(Annotated(), "frame", "target") == ("frame", "target")
