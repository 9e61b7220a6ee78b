"""Faults that are planted in frames."""

from dataclasses import replace

import numpy as np

FOCAL = ([0, 1], [0, 1])


def with_depth(frame, factor):
    return replace(frame, depth=(frame.depth * factor).astype(np.float32))


def with_matrix(frame, factor, where=FOCAL):
    """The frame with both focal lengths, or other numbers of its camera, times a factor."""
    matrix = frame.camera_matrix.copy()
    matrix[where] *= factor
    return replace(frame, camera_matrix=matrix)


def exchanged(frame):
    """The frame with red and blue exchanged."""
    return replace(frame, rgb=np.ascontiguousarray(frame.rgb[..., ::-1]))
