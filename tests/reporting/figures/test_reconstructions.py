import numpy as np

from hlp.reporting.figures.viewpoints import ReconstructedPatches, draw_reconstructions


def channels(*levels: float) -> np.ndarray:
    """Patches of 4 × 4 px, each of one level in all channels."""
    made = np.array(levels, dtype=np.float32)[:, None, None, None] * np.ones((1, 4, 4, 4))
    return np.asarray(made, dtype=np.float32)


def rows_of(picture: np.ndarray, grey: int) -> np.ndarray:
    return np.nonzero((picture == grey).all(axis=2))[0]


def test_what_was_rebuilt_stands_below_each_patch() -> None:
    found = ReconstructedPatches("cat", channels(0.97, 0.97), channels(0.99, 0.99))
    picture = draw_reconstructions([found])
    patches, rebuilt = rows_of(picture, 251), rows_of(picture, 254)
    assert len(patches) == len(rebuilt) == 2 * 64 * 64
    assert patches.max() < rebuilt.min()


def test_all_targets_have_their_rows() -> None:
    one, more = (
        draw_reconstructions([ReconstructedPatches("cat", channels(0.5), channels(0.4))] * count)
        for count in (1, 3)
    )
    assert more.shape[0] > 2.5 * one.shape[0] - 100 and more.shape[1] == one.shape[1]
