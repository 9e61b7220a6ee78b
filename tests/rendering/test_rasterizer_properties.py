"""The z-buffer against a ray caster written here, for meshes of any triangles."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from generated_values import SEEDS, numbers
from hlp.records import Mesh
from hlp.rendering.rasterizer import render_depth

SHAPE = (24, 32)
CLEAR = 1e-6  # barycentric; nearer to an edge than this, a pixel may count as inside or outside


def cast(mesh, camera):
    """Depth (rays, triangles) where a ray hits for certain, and where it may; else infinite."""
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].reshape(2, -1)
    focal, middle = camera[[0, 1], [0, 1]], camera[:2, 2]
    rays = np.column_stack([(np.column_stack([x, y]) - middle) / focal, np.ones(len(x))])
    corners = mesh.vertices[mesh.faces]
    # A ray r hits the triangle (a, b, c) where [a b c] w = r has only positive weights.
    weights = np.einsum("fij,rj->rfi", np.linalg.inv(np.swapaxes(corners, 1, 2)), rays)
    total = weights.sum(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        least = (weights / total[..., None]).min(axis=2)
        depth = 1.0 / total
    surely = np.where((total > 0) & (least > CLEAR), depth, np.inf)
    perhaps = np.where((total > 0) & (least > -CLEAR), depth, np.inf)
    return surely, perhaps


@st.composite
def triangles(draw):
    """Triangles in front of a camera, some beyond the image's border, none seen edge-on."""
    rng = np.random.default_rng(draw(SEEDS))
    focal = draw(numbers(10.0, 60.0))
    camera = np.array([[focal, 0.0, 15.3], [0.0, focal * 1.1, 11.6], [0.0, 0.0, 1.0]])
    count = draw(st.integers(1, 30))
    z = rng.uniform(0.2, draw(numbers(0.3, 5.0)), (3 * count, 1))
    pixels = rng.uniform(-20, 50, (3 * count, 2))
    vertices = np.hstack([(pixels - camera[:2, 2]) / camera[[0, 1], [0, 1]] * z, z])
    faces = np.arange(3 * count).reshape(-1, 3)
    a, b, c = (pixels[faces[:, i]] for i in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    faces = faces[np.abs(area) > 0.1]
    grey = np.zeros((len(vertices), 3), np.uint8)
    return Mesh(vertices, faces, grey, np.zeros_like(vertices)), camera


@given(triangles())
def test_the_nearest_triangle_is_drawn_at_its_depth(case):
    mesh, camera = case
    if len(mesh.faces) == 0:
        return
    drawn = render_depth(mesh, np.eye(4)[None], camera, SHAPE)[0].ravel()
    surely, perhaps = cast(mesh, camera)
    nearest = surely.min(axis=1)
    tolerance = 1e-5 * np.where(np.isfinite(nearest), nearest, 1.0)
    seen = drawn > 0
    assert not (np.isfinite(nearest) & ~seen).any()
    assert (drawn[seen] <= nearest[seen] + tolerance[seen]).all()
    apart = np.abs(perhaps - drawn[:, None]).min(axis=1)
    assert (apart[seen] < 1e-5 * drawn[seen]).all()
