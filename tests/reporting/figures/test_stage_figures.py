"""What the stages work with: viewpoints, sheets of small images, the swarm's costs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hlp.records import LocalPatches
from hlp.reporting.figures import save_jpeg
from hlp.reporting.figures.stage_figures import (
    NOTHING,
    PatchEntries,
    SwarmsOfTarget,
    depth_tile,
    directions,
    entries_sheet,
    swarm_figure,
    training_sheet,
    view_sheet,
    viewpoint_figure,
)
from view_records import square_views

RED, BLACK, GREY = (255, 0, 0), (0, 0, 0), (NOTHING,) * 3


def sheet_of(figure: Any) -> np.ndarray:
    """The tiles of a sheet."""
    return np.asarray(figure.axes[0].images[0].get_array())


def places(picture: np.ndarray, color: int | tuple[int, int, int]) -> tuple[np.ndarray, ...]:
    """Rows and columns of the pixels of a colour."""
    return np.nonzero((picture == color).all(axis=2))


def test_viewpoints_are_counted_once(tmp_path: Path) -> None:
    points = directions(square_views())
    assert len(points) == 4 and [0.0, 0.0, -1.0] in points.tolist()  # the camera looks along +z
    figure = viewpoint_figure(square_views(), "cat")
    title = figure.get_suptitle()
    assert "cat" in title and "4 viewpoints, 2 turns" in title
    save_jpeg(figure, tmp_path / "viewpoints.jpg")
    assert 5000 < (tmp_path / "viewpoints.jpg").stat().st_size < 200_000


def test_each_object_has_a_row_of_views_before_grey() -> None:
    views = square_views()
    figure = view_sheet({"cat": views, "duck": views})
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["cat", "duck"]
    shown, back = (len(places(sheet_of(figure), grey)[0]) for grey in (90, 200))
    assert shown == 2 * np.count_nonzero(views.depth)
    assert back == 2 * np.count_nonzero(views.depth == 0)


def windows() -> np.ndarray:
    """Three windows of 8 × 8 px, near everywhere; the second one is red, the others are black."""
    made = np.full((3, 4, 8, 8), -1.0, np.float32)
    made[1, 0] = 1.0
    return made


def test_windows_stand_in_the_row_of_their_class() -> None:
    picture = sheet_of(training_sheet(windows(), np.array([0, 1, 0]), ["background", "cat"]))
    red, black = places(picture, RED)[0], places(picture, BLACK)[0]
    assert len(red) == 64 and len(black) == 2 * 64
    assert black.max() < red.min()


def test_missing_depth_is_grey_and_windows_without_depth_have_no_tile_for_it() -> None:
    labels, names = np.array([0, 1, 1]), ["background", "cat"]
    missing = windows()
    missing[1, 3] = 1.0
    grey, without = (training_sheet(w, labels, names) for w in (missing, missing[:, :3]))
    assert len(places(sheet_of(grey), GREY)[0]) == 64
    # Two windows in the longest row; no scale of depth.
    assert sheet_of(grey).shape[1] - sheet_of(without).shape[1] == 2 * 8
    assert (len(grey.axes), len(without.axes)) == (2, 1)


def test_a_patch_stands_before_its_entries_nearest_first() -> None:
    greys = np.array([251, 252, 253], np.uint8)
    color = np.broadcast_to(greys[:, None, None, None], (3, 4, 4, 3))
    valid, none = np.ones((3, 4, 4), bool), np.zeros((3, 2))
    patches = LocalPatches(color, np.zeros((3, 4, 4), np.float32), valid, np.zeros((3, 3)), none)
    near = PatchEntries("cat", patches, np.array([0.1, 0.2]), np.array([0.0, 0.05]))
    figure = entries_sheet([near, near])
    columns = [places(sheet_of(figure), grey)[1] for grey in greys]
    assert [len(column) for column in columns] == [2 * 4 * 4] * 3
    assert columns[0].max() < columns[1].min() and columns[1].max() < columns[2].min()
    words = [text.get_text() for text in figure.axes[0].texts]
    assert words == 2 * ["", "0.10, 0 mm off", "0.20, 50 mm off"]


def test_depth_is_lighter_the_nearer_and_grey_where_it_is_not_valid() -> None:
    depth, valid = np.array([[-1.0, -0.5], [0.5, 1.0]]), np.ones((2, 2), dtype=bool)
    lights = depth_tile(depth, valid).reshape(4, 3) @ [0.299, 0.587, 0.114]
    assert lights.tolist() == sorted(lights, reverse=True)
    assert (depth_tile(depth, ~valid) == NOTHING).all()


COSTS = np.array([[0.6, 0.5], [0.4, 0.7], [0.5, 0.8]])


def test_the_swarms_of_each_target_have_a_panel(tmp_path: Path) -> None:
    targets = [
        SwarmsOfTarget("a", [COSTS, COSTS + 0.1], 0, 0.15, 0.18),
        SwarmsOfTarget("b", [COSTS + 0.1], None, 0.1, None),
    ]
    figure = swarm_figure(targets)
    first, second = figure.axes
    lines = {str(line.get_label()): line for line in first.lines}
    np.testing.assert_allclose(lines["best of the chosen swarm"].get_ydata(), [0.5, 0.4, 0.4])
    np.testing.assert_allclose(lines["best of another swarm"].get_ydata(), [0.6, 0.5, 0.5])
    np.testing.assert_allclose(lines["true pose"].get_ydata(), 0.15)
    assert {str(line.get_label()) for line in second.lines} == {
        "best of another swarm", "true pose",
    }  # fmt: skip
    save_jpeg(figure, tmp_path / "swarms.jpg")
    assert 5000 < (tmp_path / "swarms.jpg").stat().st_size < 200_000


@pytest.mark.parametrize("chosen", [0, None])  # None: no shown swarm has found the answer
def test_the_answer_is_a_star_at_the_end(chosen: int | None) -> None:
    figure = swarm_figure([SwarmsOfTarget("a", [COSTS], chosen, 0.1, 0.3)])
    (star,) = [line for line in figure.axes[0].lines if line.get_label() == "answer"]
    assert (*star.get_xdata(), *star.get_ydata()) == (2, 0.3)
