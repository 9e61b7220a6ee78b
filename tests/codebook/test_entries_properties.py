"""Codebooks on disk: every bit comes back."""

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from generated_values import SEEDS
from hlp.codebook.entries import load_codebook, save_codebook
from hlp.records import Codebook

FEATURES = arrays.arrays(
    np.float32,
    st.tuples(st.integers(0, 6), st.integers(1, 5)),
    elements=st.floats(width=32, allow_nan=True, allow_infinity=True),
)


@given(FEATURES, st.integers(0, 2**31), st.floats(1e-6, 1e6), SEEDS)
def test_a_codebook_comes_back_bit_for_bit(tmp_path: Path, features, object_id, scale, seed):
    rng = np.random.default_rng(seed)
    rotations = rng.normal(size=(len(features), 3, 3)).astype(np.float32)
    points = rng.normal(size=(len(features), 3)).astype(np.float32)
    sent = Codebook(object_id, features, rotations, points, scale)
    save_codebook(tmp_path, sent)
    back = load_codebook(tmp_path)
    assert (back.object_id, back.feature_scale) == (object_id, scale)
    assert back.features.tobytes() == features.tobytes()
    assert back.features.shape == features.shape
    np.testing.assert_array_equal(back.rotations_cam_obj, rotations)
    np.testing.assert_array_equal(back.points_obj, points)
