"""Depth of boxes along rays, without triangles, renderer or any other part of HLP."""

import numpy as np


def box_depth(pose, extents, camera, shape, offset):
    """Depth where the rays through pixels + offset enter a box about its origin; 0 beside it."""
    y, x = np.mgrid[: shape[0], : shape[1]] + offset
    across, down = (x - camera[0, 2]) / camera[0, 0], (y - camera[1, 2]) / camera[1, 1]
    turn = pose[:3, :3]
    start, along = -turn.T @ pose[:3, 3], np.stack([across, down, np.ones(shape)], axis=-1) @ turn
    ends = np.stack([(side * np.asarray(extents) / 2 - start) / along for side in (-1, 1)])
    enter, leave = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
    return np.where((enter < leave) & (enter > 0), enter, 0.0)


def scene_depth(boxes, camera, shape, occluded, hole):
    """Depth image (mm) of a wall at 1300, `boxes` (pose and extents) and a near plane on the left.

    The plane covers the first `occluded` columns; nothing is measured in the rows from `hole` on.
    """
    depth = np.full(shape, 1300.0)
    for pose, extents in boxes:
        own = box_depth(pose, extents, camera, shape, 0.0)
        depth = np.where(own > 0, np.minimum(own, depth), depth)
    depth[:, :occluded] = 500.0
    depth[hole:] = 0.0
    return depth
