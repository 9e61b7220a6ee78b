"""Names of frames: each has one, and it leads back."""

from hypothesis import example, given
from hypothesis import strategies as st

from hlp.records import frame_key, parse_frame_key

IDS = st.integers(0, 10**8)


@given(IDS, IDS)
def test_a_frame_comes_back_from_its_key(scene, frame):
    assert parse_frame_key(frame_key(scene, frame)) == (scene, frame)


@given(st.text("0123456789_²٣ -", max_size=20))
@example("000006_0000²²")
@example("00000٣_000012")
def test_no_other_text_is_a_key(text):
    try:
        ids = parse_frame_key(text)
    except ValueError as error:
        assert "is no frame key" in str(error)
    else:
        assert frame_key(*ids) == text
