from pathlib import Path

import numpy as np

from hlp.reporting.figures.saving import save_jpeg
from hlp.reporting.figures.viewpoints import directions, nearest_angles_deg, viewpoint_figure
from view_records import square_views


def test_viewpoints_are_counted_once_with_the_angle_to_the_next() -> None:
    points = directions(square_views())
    assert len(points) == 4
    np.testing.assert_allclose(points[0], [0, 0, -1], atol=1e-12)  # the camera looks along +z
    np.testing.assert_allclose(nearest_angles_deg(points), 90.0)


def test_the_figure_says_how_many_there_are(tmp_path: Path) -> None:
    figure = viewpoint_figure(square_views(), "cat")
    title = figure.get_suptitle()
    assert "cat" in title and "4 viewpoints, 2 turns" in title and "90.0°" in title
    save_jpeg(figure, tmp_path / "viewpoints.jpg")
    assert 5000 < (tmp_path / "viewpoints.jpg").stat().st_size < 200_000
