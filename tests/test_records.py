"""Names of frames: each has one, and it leads back; the shapes of records are checked in tests."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hlp.records import Texture, frame_key, parse_frame_key

IDS = st.integers(0, 10**8)


@given(IDS, IDS)
@example(0, 1234567)
def test_a_frame_comes_back_from_its_key(scene, frame):
    assert parse_frame_key(frame_key(scene, frame)) == (scene, frame)
    assert frame_key(6, 12) == "000006_000012"


@given(st.text("0123456789_²٣ -", max_size=20))
@example("000006_00001x")
@example("000006_000012_1")
@example("-00006_000012")
@example("000006_0000²²")
@example("00000٣_000012")
def test_no_other_text_is_a_key(text):
    try:
        ids = parse_frame_key(text)
    except ValueError as error:
        assert "is not a frame key" in str(error)
    else:
        assert frame_key(*ids) == text


def test_shapes_of_records_are_checked_while_tests_run():
    with pytest.raises(Exception, match="uv"):
        Texture(np.zeros((2, 2, 3), np.uint8), np.zeros((4, 3)))
