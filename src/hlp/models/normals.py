"""Surface normals of local patches' depth, in one compiled pass."""

import numpy as np
from jaxtyping import Bool, Float

from hlp.compiled import compiled


@compiled()
def normals_and_depth(
    depth: Float[np.ndarray, "n p p"],
    valid: Bool[np.ndarray, "n p p"],
    out: Float[np.ndarray, "n p p 4"],
) -> None:
    """Fill `out` with unit normals (0 where not valid) and the unchanged depth, all float32.

    For the normals, depth is smoothed twice over the valid pixels of 3 × 3. At a pixel pitch of
    1–3 mm, a Kinect's noise and quantisation are as large as the differences between pixels.
    """
    count, size = depth.shape[:2]
    surface = np.empty((size, size), dtype=np.float32)
    weight, rows = np.empty_like(surface), np.empty_like(surface)
    one, none = np.float32(1.0), np.float32(0.0)
    # In units of half the metric size, as depth is, the pitch is 2 / size. Differences span two.
    scale = np.float32(size / 4.0)
    for i in range(count):
        for y in range(size):
            for x in range(size):
                weight[y, x] = one if valid[i, y, x] else none
                surface[y, x] = depth[i, y, x] * weight[y, x]
        for _ in range(2):
            _average(surface, rows)
            _average(weight, rows)
        for y in range(size):
            for x in range(size):
                known = weight[y, x] > np.float32(0.05)
                surface[y, x] = surface[y, x] / weight[y, x] if known else depth[i, y, x]
        for y in range(size):
            above, below = max(y - 1, 0), min(y + 1, size - 1)
            for x in range(size):
                left, right = max(x - 1, 0), min(x + 1, size - 1)
                dx = (surface[y, right] - surface[y, left]) * scale
                dy = (surface[below, x] - surface[above, x]) * scale
                length = np.sqrt(dx * dx + dy * dy + one)
                share = one / length if valid[i, y, x] else none
                out[i, y, x, 0] = dx * share
                out[i, y, x, 1] = dy * share
                out[i, y, x, 2] = -share
                out[i, y, x, 3] = depth[i, y, x]


@compiled()
def _average(image: Float[np.ndarray, "p p"], rows: Float[np.ndarray, "p p"]) -> None:
    """Mean of 3 × 3 pixels in place, without pixels beyond the border; `rows` is a buffer."""
    size = image.shape[0]
    last, ninth = size - 1, np.float32(1.0 / 9.0)
    for y in range(size):
        rows[y, 0] = image[y, 0] + image[y, 1]
        for x in range(1, last):
            rows[y, x] = image[y, x - 1] + image[y, x] + image[y, x + 1]
        rows[y, last] = image[y, last - 1] + image[y, last]
    for x in range(size):
        image[0, x] = (rows[0, x] + rows[1, x]) * ninth
    for y in range(1, last):
        for x in range(size):
            image[y, x] = (rows[y - 1, x] + rows[y, x] + rows[y + 1, x]) * ninth
    for x in range(size):
        image[last, x] = (rows[last - 1, x] + rows[last, x]) * ninth
