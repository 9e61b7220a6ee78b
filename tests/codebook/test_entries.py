"""Codebooks on disk: features come back with 16 significant bits, everything else whole."""

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
    elements=st.floats(-(2.0**99), 2.0**99, width=32, allow_subnormal=False),
)


@given(FEATURES, st.integers(0, 2**31), st.floats(1e-6, 1e6), SEEDS)
def test_a_codebook_comes_back_rounded_once(tmp_path, features, object_id, scale, seed):
    rng = np.random.default_rng(seed)
    rotations = rng.normal(size=(len(features), 3, 3)).astype(np.float32)
    points = rng.normal(size=(len(features), 3)).astype(np.float32)
    save_codebook(tmp_path, Codebook(object_id, features, rotations, points, scale))
    back = load_codebook(tmp_path)
    assert (back.object_id, back.feature_scale) == (object_id, scale)
    mantissas, exponents = np.frexp(features.astype(np.float64))
    rounded = np.ldexp(np.rint(mantissas * 2.0**16) / 2.0**16, exponents)
    np.testing.assert_array_equal(back.features, rounded)
    assert back.features.dtype == np.float32
    save_codebook(tmp_path, back)
    assert load_codebook(tmp_path).features.tobytes() == back.features.tobytes()
    np.testing.assert_array_equal(back.rotations_cam_obj, rotations)
    np.testing.assert_array_equal(back.points_obj, points)
