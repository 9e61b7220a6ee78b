"""Sheets of small images of what the stages work with."""

from pathlib import Path

import numpy as np
import pytest

from hlp.records import LocalPatches
from hlp.reporting.figures import save_jpeg
from hlp.reporting.figures.stage_figures import directions, nearest_angles_deg, viewpoint_figure
from hlp.reporting.figures.stage_sheets import (
    NOTHING,
    PatchEntries,
    depth_tile,
    draw_nearest_entries,
    draw_training_samples,
    draw_view_sheet,
    resized,
    sheet,
    with_depths,
)
from view_records import square_views

RED, BLACK, GREY = (255, 0, 0), (0, 0, 0), (NOTHING,) * 3


def places(picture: np.ndarray, color: int | tuple[int, int, int]) -> tuple[np.ndarray, ...]:
    """Rows and columns of the pixels of a colour."""
    return np.nonzero((picture == color).all(axis=2))


def test_viewpoints_are_counted_once_with_the_angle_to_the_next(tmp_path: Path) -> None:
    points = directions(square_views())
    assert len(points) == 4
    np.testing.assert_allclose(points[0], [0, 0, -1], atol=1e-12)  # the camera looks along +z
    np.testing.assert_allclose(nearest_angles_deg(points), 90.0)
    assert np.isnan(nearest_angles_deg(points[:1])).all()
    figure = viewpoint_figure(square_views(), "cat")
    title = figure.get_suptitle()
    assert "cat" in title and "4 viewpoints, 2 turns" in title and "90.0°" in title
    save_jpeg(figure, tmp_path / "viewpoints.jpg")
    assert 5000 < (tmp_path / "viewpoints.jpg").stat().st_size < 200_000


def test_each_object_has_a_row_of_views_before_grey() -> None:
    one = draw_view_sheet({"cat": square_views()})
    two = draw_view_sheet({"cat": square_views(), "duck": square_views()})
    assert two.shape[0] > one.shape[0]
    for picture, rows in ((one, 1), (two, 2)):
        shown, back = (len(places(picture, grey)[0]) for grey in (90, 200))
        # Half of a tile's side of 84 px; a few pixels of the words have these greys, too.
        assert shown == pytest.approx(rows * 8 * 42**2, abs=80)
        assert back == pytest.approx(rows * 8 * (84**2 - 42**2), abs=80)


def windows() -> np.ndarray:
    """Three windows of 8 × 8 px, near everywhere; the second one is red, the others are black."""
    made = np.full((3, 4, 8, 8), -1.0, np.float32)
    made[1, 0] = 1.0
    return made


def test_windows_stand_in_the_row_of_their_class() -> None:
    picture = draw_training_samples(windows(), np.array([0, 1, 0]), ["background", "cat"])
    red, black = places(picture, RED)[0], places(picture, BLACK)[0]
    assert len(red) == 64 and len(black) == 2 * 64
    assert black.max() < red.min()


def test_missing_depth_is_grey_and_windows_without_depth_have_no_tile_for_it() -> None:
    labels, names = np.array([0, 1, 1]), ["background", "cat"]
    whole, missing = windows(), windows()
    missing[1, 3] = 1.0
    drawn, grey = (draw_training_samples(images, labels, names) for images in (whole, missing))
    assert len(places(grey, GREY)[0]) - len(places(drawn, GREY)[0]) == 64
    without = draw_training_samples(whole[:, :3], labels, names)
    assert drawn.shape[1] - without.shape[1] == 2 * 8  # two windows in the longest row


def test_a_patch_stands_before_its_entries_nearest_first() -> None:
    color = np.array([251, 252, 253], np.uint8)[:, None, None, None] * np.ones(
        (1, 4, 4, 3), np.uint8
    )
    valid, none = np.ones((3, 4, 4), bool), np.zeros((3, 2))
    patches = LocalPatches(color, np.zeros((3, 4, 4), np.float32), valid, np.zeros((3, 3)), none)
    near = PatchEntries("cat", patches, np.array([0.1, 0.2]), np.array([0.0, 0.05]))
    picture = draw_nearest_entries([near, near])
    columns = [places(picture, grey)[1] for grey in (251, 252, 253)]
    assert [len(column) for column in columns] == [2 * 64 * 64] * 3
    assert columns[0].max() < columns[1].min() and columns[1].max() < columns[2].min()


def test_depth_is_lighter_the_nearer_and_grey_where_it_is_not_valid() -> None:
    depth, valid = np.array([[-1.0, -0.5], [0.5, 1.0]]), np.ones((2, 2), dtype=bool)
    lights = depth_tile(depth, valid).reshape(4, 3) @ [0.299, 0.587, 0.114]
    assert lights.tolist() == sorted(lights, reverse=True)
    assert (depth_tile(depth, ~valid) == NOTHING).all()
    # No depth has a colour near the grey that means none.
    scale = depth_tile(np.linspace(-1, 1, 400).reshape(20, 20), np.ones((20, 20), dtype=bool))
    assert np.abs(scale.astype(int) - NOTHING).max(axis=2).min() > 20


def test_rows_of_a_sheet_are_filled_up() -> None:
    tile = np.full((12, 12, 3), 200, dtype=np.uint8)
    shown = sheet([("", [tile, tile]), ("", [tile])])
    assert shown.shape == (2 * (12 + 4), 8 + 2 * (12 + 4), 3)
    assert len(places(shown, 200)[0]) == 3 * 144
    with pytest.raises(ValueError, match="at least one tile"):
        sheet([("a", [])])


def test_the_legend_of_depth_is_below_the_picture() -> None:
    picture = np.full((30, 400, 3), 200, dtype=np.uint8)
    plain, worded = with_depths(picture), with_depths(picture, "words")
    assert len(places(plain, NOTHING)[0]) >= 100
    np.testing.assert_array_equal(plain[:30], picture)
    assert len(worded) - len(plain) == len(plain) - 30 > 0


def test_tiles_grow_in_square_pixels() -> None:
    tile = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    np.testing.assert_array_equal(resized(tile, 4), tile.repeat(2, axis=0).repeat(2, axis=1))
