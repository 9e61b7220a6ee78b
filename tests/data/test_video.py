import cv2
import numpy as np
import pytest

from hlp.data.video import VideoFrames, count_video_frames

SHADES = range(20, 240, 20)


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """A video whose frames differ in brightness; lossless in all but rounding."""
    path = tmp_path_factory.mktemp("video") / "v.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10, (64, 48))
    for shade in SHADES:
        writer.write(np.full((48, 64, 3), (0, 0, shade), np.uint8))  # red, in OpenCV's order
    writer.release()
    return path


def test_frames_come_in_order_and_again_as_rgb(video):
    frames = VideoFrames(video)
    for index in (0, 1, 2, 7, 3, 3, 10):
        image = frames.read(index)
        assert image.shape == (48, 64, 3)
        assert abs(int(np.median(image[..., 0])) - SHADES[index]) <= 3
        assert np.median(image[..., 2]) <= 10


def test_frames_are_counted_and_the_last_one_is_the_end(video):
    assert count_video_frames(video) == len(SHADES)
    with pytest.raises(ValueError, match=r"v\.avi: frame 11 cannot be read"):
        VideoFrames(video).read(len(SHADES))


def test_what_is_no_video_is_named(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"no video")
    with pytest.raises(ValueError, match=r"a\.mp4 is truncated or no video"):
        count_video_frames(tmp_path / "a.mp4")
