import numpy as np
import pytest

from hlp.records import Texture, frame_key, parse_frame_key


@pytest.mark.parametrize(
    ("ids", "key"), [((6, 12), "000006_000012"), ((0, 1234567), "000000_1234567")]
)
def test_frame_keys_hold_scene_and_frame(ids: tuple[int, int], key: str) -> None:
    assert frame_key(*ids) == key
    assert parse_frame_key(key) == ids


@pytest.mark.parametrize(
    "text", ["", "000006", "6_12", "000006_00001x", "000006_000012_1", "-00006_000012"]
)
def test_other_texts_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is no frame key"):
        parse_frame_key(text)


def test_shapes_of_records_are_checked_while_tests_run() -> None:
    with pytest.raises(Exception, match="uv"):
        Texture(np.zeros((2, 2, 3), np.uint8), np.zeros((4, 3)))
