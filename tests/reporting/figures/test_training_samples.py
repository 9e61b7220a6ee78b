import numpy as np

from hlp.reporting.figures.tiles import NOTHING
from hlp.reporting.figures.viewpoints import draw_training_samples

RED, BLACK = (255, 0, 0), (0, 0, 0)


def images() -> np.ndarray:
    """Three windows of 8 × 8 px, near everywhere; the second one is red, the others are black."""
    made = np.full((3, 4, 8, 8), -1.0, np.float32)
    made[1, 0] = 1.0
    return made


def rows_of(picture: np.ndarray, color: tuple[int, int, int]) -> np.ndarray:
    return np.nonzero((picture == color).all(axis=2))[0]


def test_windows_stand_in_the_row_of_their_class() -> None:
    picture = draw_training_samples(images(), np.array([0, 1, 0]), ["background", "cat"])
    red, black = rows_of(picture, RED), rows_of(picture, BLACK)
    assert len(red) == 64 and len(black) == 2 * 64
    assert black.max() < red.min()


def test_missing_depth_is_grey() -> None:
    windows = images()
    windows[1, 3] = 1.0
    grey = [
        len(rows_of(draw_training_samples(each, np.array([1, 1, 1]), ["a", "b"]), (NOTHING,) * 3))
        for each in (images(), windows)
    ]
    assert grey[1] - grey[0] == 64


def test_windows_without_depth_have_no_tile_for_it() -> None:
    labels, names = np.array([0, 1, 1]), ["background", "cat"]
    with_depth = draw_training_samples(images(), labels, names)
    without = draw_training_samples(images()[:, :3], labels, names)
    assert with_depth.shape[1] - without.shape[1] == 2 * 8  # two windows in the longest row
