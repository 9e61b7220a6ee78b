"""A small rendered RGB-D image of a learnt object: an example of what a detector takes."""

import numpy as np

from hlp.geometry import rigid
from hlp.records import CameraImage, ObjectModel
from hlp.rendering.light import FRONTAL_LIGHT
from hlp.rendering.rasterizer import render_scene
from hlp.rendering.viewpoints import view_rotations

_SHAPE = (120, 160)  # px: height, width
_FOCAL = 145.0  # px: a Kinect's, for a quarter of its resolution
_NEAREST = 0.4  # m
_FROM = (1.0, 0.6, 0.8)  # direction in the object's frame from which it is seen
_WALL = (178, 172, 160)


def example_image(model: ObjectModel) -> CameraImage:
    """An object in the air before a grey wall (120 × 160 px), seen obliquely from above.

    Its depth is in whole millimetres, as a camera delivers it.
    """
    height, width = _SHAPE
    camera_matrix = np.array([[_FOCAL, 0, width / 2], [0, _FOCAL, height / 2], [0, 0, 1.0]])
    distance = max(_NEAREST, 3.0 * model.diameter)
    rotation = view_rotations(np.array([_FROM]), np.zeros(1))[0]
    center = np.array([0.0, 0.0, distance])
    pose = rigid(rotation, center - rotation @ model.centroid)
    rgb, depth, index = render_scene([(model.mesh, pose)], camera_matrix, _SHAPE, FRONTAL_LIGHT)
    rgb[index < 0], depth[index < 0] = _WALL, distance + model.diameter
    return CameraImage(rgb, np.round(depth, 3).astype(np.float32), camera_matrix)
