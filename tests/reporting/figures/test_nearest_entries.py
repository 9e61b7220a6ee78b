import numpy as np

from hlp.records import LocalPatches
from hlp.reporting.figures.viewpoints import PatchEntries, draw_nearest_entries


def patches(*greys: int) -> LocalPatches:
    count = len(greys)
    color = np.array(greys, dtype=np.uint8)[:, None, None, None] * np.ones((1, 4, 4, 3), np.uint8)
    return LocalPatches(
        color,
        np.zeros((count, 4, 4), np.float32),
        np.ones((count, 4, 4), bool),
        np.zeros((count, 3)),
        np.zeros((count, 2)),
    )


def test_a_patch_stands_before_its_entries_nearest_first() -> None:
    near = PatchEntries("cat", patches(251, 252, 253), np.array([0.1, 0.2]), np.array([0.0, 0.05]))
    picture = draw_nearest_entries([near, near])
    columns = [np.nonzero((picture == grey).all(axis=2))[1] for grey in (251, 252, 253)]
    assert [len(each) for each in columns] == [2 * 64 * 64] * 3
    assert columns[0].max() < columns[1].min() and columns[1].max() < columns[2].min()
