"""Direction of the edges of a rendered mesh, compiled: shared by refinement and verification."""

import numpy as np
from jaxtyping import Float32

from hlp.compiled import compiled

DIRECTIONS = 4
"""Directions of an edge's gradient, of half a turn, from that of x towards y."""
_ZERO, _TWO, _EIGHTH = np.float32(0.0), np.float32(2.0), np.float32(np.tan(np.pi / 8.0))


@compiled(inline="always")
def edge_direction(
    above: Float32[np.ndarray, "3"], here: Float32[np.ndarray, "3"], below: Float32[np.ndarray, "3"]
) -> int:
    """Which of `DIRECTIONS` the gradient of inverse depth has, which is 0 beside a mesh.

    Takes the pixel, in the middle of `here`, and the eight around it.
    """
    rising, falling = below[2] - above[0], above[2] - below[0]
    x = _TWO * (here[2] - here[0]) + rising + falling
    y = _TWO * (below[1] - above[1]) + rising - falling
    turned = x * y
    x, y = abs(x), abs(y)
    if y < _EIGHTH * x:
        return 0
    if x < _EIGHTH * y:
        return 2
    return 1 if turned > _ZERO else 3
