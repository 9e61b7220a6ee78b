import numpy as np
import pytest

from hlp.reporting.figures.tiles import NOTHING, depth_tile, resized, sheet, with_depths


def lightness(color: np.ndarray) -> float:
    return float(color @ [0.299, 0.587, 0.114])


def test_depth_is_lighter_the_nearer_and_grey_where_it_is_not_valid() -> None:
    depth, valid = np.array([[-1.0, -0.5], [0.5, 1.0]]), np.ones((2, 2), dtype=bool)
    near, nearer, farther, far = depth_tile(depth, valid).reshape(4, 3)
    lights = [lightness(each) for each in (near, nearer, farther, far)]
    assert lights == sorted(lights, reverse=True)
    assert (depth_tile(depth, ~valid) == NOTHING).all()
    # No depth has a colour near the grey that means none.
    scale = depth_tile(np.linspace(-1, 1, 400)[None].reshape(20, 20), np.ones((20, 20), dtype=bool))
    assert np.abs(scale.astype(int) - NOTHING).max(axis=2).min() > 20


def test_rows_of_a_sheet_are_filled_up() -> None:
    tile = np.full((12, 12, 3), 200, dtype=np.uint8)
    shown = sheet([("", [tile, tile]), ("", [tile])])
    assert shown.shape == (2 * (12 + 4), 8 + 2 * (12 + 4), 3)
    assert (shown == 200).all(axis=2).sum() == 3 * 144
    with pytest.raises(ValueError, match="at least one tile"):
        sheet([("a", [])])


def test_the_legend_of_depth_is_below_the_picture() -> None:
    picture = np.full((30, 400, 3), 200, dtype=np.uint8)
    plain, worded = with_depths(picture), with_depths(picture, "words")
    grey = (plain == NOTHING).all(axis=2).sum()
    assert grey - (with_depths(picture, missing=False) == NOTHING).all(axis=2).sum() >= 100
    np.testing.assert_array_equal(plain[:30], picture)
    assert len(worded) - len(plain) == len(plain) - 30 > 0


def test_tiles_grow_in_square_pixels() -> None:
    tile = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    np.testing.assert_array_equal(resized(tile, 4), tile.repeat(2, axis=0).repeat(2, axis=1))
