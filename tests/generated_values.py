"""Values that property tests draw: rotations, poses, cameras, points, plain JSON."""

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hlp.geometry import rigid

SEEDS = st.integers(0, 2**32 - 1)
"""Of numpy's generators, where the many numbers of an array need not become simpler."""


def share_of_examples(divisor: int) -> settings:
    """Fewer examples than the profile's, for a test that takes long."""
    return settings(max_examples=max(2, settings.default.max_examples // divisor))


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


def vectors(low: float, high: float, length: int = 3) -> st.SearchStrategy[np.ndarray]:
    return st.lists(numbers(low, high), min_size=length, max_size=length).map(np.array)


def rotations() -> st.SearchStrategy[np.ndarray]:
    quaternions = vectors(-1.0, 1.0, 4).filter(lambda quaternion: np.linalg.norm(quaternion) > 0.1)
    return quaternions.map(lambda quaternion: Rotation.from_quat(quaternion).as_matrix())


def motions(reach: float = 2.0) -> st.SearchStrategy[np.ndarray]:
    """Rigid motions (4, 4) with translations of up to that many metres along each axis."""
    return st.builds(rigid, rotations(), vectors(-reach, reach))


def turns_about_z(count: int) -> np.ndarray:
    """Motions (n, 4, 4) that turn by equal steps, the first by nothing."""
    turns = np.arange(count)[:, None] * [0.0, 0.0, 2 * np.pi / count]
    return rigid(Rotation.from_rotvec(turns).as_matrix(), np.zeros(3))


@st.composite
def poses_in_front(draw: st.DrawFn) -> np.ndarray:
    """Poses of an object of at most 10 cm around its origin, in front of the camera."""
    x, y, z = draw(numbers(-0.4, 0.4)), draw(numbers(-0.3, 0.3)), draw(numbers(0.3, 2.0))
    return rigid(draw(rotations()), np.array([x, y, z]))


@st.composite
def cameras(draw: st.DrawFn) -> np.ndarray:
    fx, fy = draw(numbers(50.0, 2000.0)), draw(numbers(50.0, 2000.0))
    cx, cy = draw(numbers(0.0, 1280.0)), draw(numbers(0.0, 960.0))
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


@st.composite
def point_sets(draw: st.DrawFn, least: int = 4, most: int = 40) -> np.ndarray:
    """Points (n, 3) within 5 cm of the origin, not all in one place."""
    rng = np.random.default_rng(draw(SEEDS))
    stretch = draw(vectors(0.05, 1.0))
    return rng.uniform(-0.05, 0.05, (draw(st.integers(least, most)), 3)) * stretch


def texts() -> st.SearchStrategy[str]:
    """Text that UTF-8 can write."""
    return st.text(st.characters(codec="utf-8"), max_size=12)


def json_values(leaves: int = 12) -> st.SearchStrategy[object]:
    """Values that JSON writes and reads as they are."""
    leaf = (
        st.none()
        | st.booleans()
        | st.integers(-(2**53), 2**53)
        | st.floats(allow_nan=False, allow_infinity=False)
        | texts()
    )
    return st.recursive(
        leaf,
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(texts(), inner, max_size=4),
        max_leaves=leaves,
    )
