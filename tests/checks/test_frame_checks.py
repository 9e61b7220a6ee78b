"""Reading frames for the doctor: what cannot be read, what makes no sense, and how many."""

import pytest

from hlp.checks.frame_checks import read_frames
from hlp.errors import DataError

KEYS = [f"000001_{i:06d}" for i in range(9)]


def _loader(frame, refused):
    def load(key):
        if key in refused:
            raise DataError(f"{key} is odd")
        return frame

    return load


@pytest.mark.parametrize(("odd", "shown", "more"), [(1, 1, ""), (3, 3, ""), (7, 3, "4 more")])
def test_of_many_files_that_cannot_be_read_the_first_are_named(frames, odd, shown, more):
    kept, findings = read_frames(_loader(frames[0], KEYS[:odd]), KEYS, 9)
    assert len(kept) == len(KEYS) - odd
    assert [each.kind for each in findings] == ["files"] * shown
    assert [each.where[:13] for each in findings] == KEYS[:shown]
    assert more in findings[-1].where and ("more" in findings[-1].where) == bool(more)


def test_frames_whose_values_make_no_sense_are_kept_with_a_finding(frames):
    load, read = _loader(frames[0], KEYS[:2]), _loader(frames[0], KEYS[1:2])
    kept, findings = read_frames(load, KEYS, 9, read)
    assert len(kept) == len(KEYS) - 1
    assert {(each.kind, each.where) for each in findings} == {
        ("values", KEYS[0]),
        ("files", KEYS[1]),
    }
