import numpy as np
import pytest

from hlp.reporting.figures.viewpoints import draw_view_sheet
from view_records import square_views


def test_each_object_has_a_row_of_views_before_grey() -> None:
    one = draw_view_sheet({"cat": square_views()})
    two = draw_view_sheet({"cat": square_views(), "duck": square_views()})
    assert two.shape[0] > one.shape[0]
    for picture, rows in ((one, 1), (two, 2)):
        object_, back = ((picture == grey).all(axis=2).sum() for grey in (90, 200))
        # Half of a tile's side of 84 px; a few pixels of the words have these greys, too.
        assert object_ == pytest.approx(rows * 8 * 42**2, abs=80)
        assert back == pytest.approx(rows * 8 * (84**2 - 42**2), abs=80)
    np.testing.assert_array_equal(np.unique(one[:, :, 0] == one[:, :, 1]), [True])
