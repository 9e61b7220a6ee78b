"""The eight demo objects: toys and tools of 12–22 cm with plain colours, modelled in code.

They have the difficulties of LINEMOD's objects: `bowl` has a continuous symmetry; `bear` and
`rabbit` have the same body and head and differ in ears and tail; `can` and `lamp` have thin parts.
The pose of the others is unambiguous from all sides. +z is up, the front faces +x, the origin is
the centre of the bounding box.
"""

from functools import lru_cache

import numpy as np

from hlp.arrays import Poses
from hlp.geometry import rigid
from hlp.objects.meshes import mesh_diameter
from hlp.objects.object_model import build_proxy, holistic_size, local_size
from hlp.objects.shapes import (
    centred,
    cylinder,
    ellipsoid,
    lathe,
    merge,
    moved,
    painted,
    rounded_box,
    tube,
)
from hlp.records import Mesh, ObjectModel
from hlp.rendering.views import turns_in_plane

PROXY_FACES = 2000
BOWL_STEPS = 180
"""Steps of 2° of the bowl's symmetry; its mesh has as many segments, so each step is exact."""

BROWN, CREAM, DARK = (133, 88, 52), (214, 189, 150), (38, 36, 38)


def _toy() -> list[Mesh]:
    """Body and head of bear and rabbit; one arm is raised, so that they are not symmetric."""
    arms = (  # one lowered, one raised
        ((0, 0.03, 0.075), (0.016, 0.044, 0.058), (0.034, 0.042, 0.048), (0.042, 0.038, 0.047)),
        ((0, -0.03, 0.075), (0.008, -0.052, 0.086), (0.012, -0.062, 0.11), (0.012, -0.064, 0.122)),
    )
    return [
        moved(ellipsoid((0.038, 0.036, 0.044), BROWN), (0.0, 0.0, 0.050)),
        moved(ellipsoid((0.030, 0.026, 0.033), CREAM), (0.013, 0.0, 0.049)),
        moved(ellipsoid((0.026, 0.015, 0.013), BROWN), (0.032, 0.026, 0.013), (0, 0, 20)),
        moved(ellipsoid((0.026, 0.015, 0.013), BROWN), (0.032, -0.026, 0.013), (0, 0, -20)),
        moved(ellipsoid((0.034, 0.037, 0.031), BROWN), (0.008, 0.0, 0.113)),
        moved(ellipsoid((0.017, 0.017, 0.012), CREAM), (0.037, 0.0, 0.105)),
        moved(ellipsoid((0.006, 0.008, 0.005), DARK), (0.053, 0.0, 0.111)),
        *(tube(arm, (0.011, 0.011, 0.012, 0.004), BROWN) for arm in arms),
    ]


def _bear() -> Mesh:
    ear = ellipsoid((0.008, 0.014, 0.014), BROWN)
    ears = [moved(ear, (0.004, y, 0.142)) for y in (0.027, -0.027)]
    tail = moved(ellipsoid((0.010, 0.011, 0.010), BROWN), (-0.037, 0.0, 0.034))
    return merge(*_toy(), *ears, tail)


def _rabbit() -> Mesh:
    ears = [
        moved(ellipsoid((0.008, 0.011, 0.037), BROWN), (-0.002, 0.019, 0.171), (-9, -8, 0)),
        moved(ellipsoid((0.008, 0.011, 0.037), BROWN), (-0.004, -0.023, 0.169), (20, -4, 0)),
    ]
    tail = moved(ellipsoid((0.016, 0.016, 0.015), CREAM), (-0.041, 0.0, 0.036))
    return merge(*_toy(), *ears, tail)


def _bowl() -> Mesh:
    outside = [(0, 0), (0.034, 0), (0.036, 0.006), (0.056, 0.018), (0.070, 0.036), (0.080, 0.062)]
    inside = [(0.076, 0.062), (0.066, 0.038), (0.052, 0.022), (0.030, 0.011), (0, 0.010)]
    bowl = lathe([*outside, *inside], (58, 96, 148), segments=BOWL_STEPS)
    radius, height = np.hypot(*bowl.vertices[:, :2].T), bowl.vertices[:, 2]
    radii, heights = np.array(inside[::-1]).T
    within = radius < np.interp(height, heights, radii) + 0.0015
    return painted(bowl, within & (height > 0.009), (206, 204, 190))


def _camera() -> Mesh:
    body = (52, 52, 56)
    line = [(0, 0), (0.029, 0), (0.029, 0.014), (0.026, 0.016), (0.026, 0.036), (0.021, 0.036)]
    lens = lathe([*line, (0.018, 0.030), (0, 0.033)], (28, 28, 30))
    return merge(
        moved(rounded_box((0.036, 0.124, 0.070), 0.008, body), (0, 0, 0.035)),
        moved(rounded_box((0.032, 0.119, 0.014), 0.005, (168, 168, 172)), (0, 0, 0.072)),
        moved(rounded_box((0.030, 0.040, 0.022), 0.006, body), (0.002, -0.012, 0.084)),
        moved(rounded_box((0.020, 0.026, 0.060), 0.008, body), (0.020, 0.046, 0.036)),
        moved(lens, (0.016, -0.012, 0.037), (0, 90, 0)),
        moved(ellipsoid((0.004, 0.017, 0.017), (70, 96, 150)), (0.048, -0.012, 0.037)),
        moved(cylinder(0.010, 0.008, (178, 40, 36)), (0.0, 0.040, 0.079)),
        moved(cylinder(0.013, 0.009, (168, 168, 172)), (-0.002, -0.048, 0.078)),
    )


def _can() -> Mesh:
    green, yellow = (44, 120, 72), (214, 176, 54)
    body = [(0, 0), (0.044, 0), (0.047, 0.010), (0.043, 0.080), (0.038, 0.092), (0.034, 0.092)]
    handle = [(0.020, 0, 0.088), (0.004, 0, 0.122), (-0.030, 0, 0.128), (-0.062, 0, 0.104)]
    spout = [(0.036, 0, 0.026), (0.064, 0, 0.050), (0.092, 0, 0.106)]
    rose = lathe([(0, 0), (0.008, 0), (0.019, 0.018), (0.017, 0.021), (0, 0.023)], yellow)
    return merge(
        lathe([*body, (0.032, 0.080), (0, 0.078)], green),
        tube([*handle, (-0.066, 0, 0.066), (-0.042, 0, 0.030)], [0.0065] * 6, green),
        tube(spout, (0.013, 0.009, 0.007), green),
        moved(rose, (0.088, 0.0, 0.098), (0, 28, 0)),
        moved(lathe([(0.0, 0), (0.048, 0), (0.048, 0.008), (0, 0.008)], yellow), (0, 0, 0.044)),
    )


def _drill() -> Mesh:
    blue, dark, steel = (38, 118, 138), (44, 44, 46), (150, 150, 152)
    motor = [(0, 0), (0.022, 0.0), (0.029, 0.012), (0.029, 0.084), (0.024, 0.106), (0.018, 0.110)]
    chuck = [(0, 0), (0.018, 0), (0.018, 0.022), (0.010, 0.040), (0.004, 0.042), (0.003, 0.066)]
    return merge(
        moved(lathe([*motor, (0, 0.110)], blue), (-0.060, 0, 0.152), (0, 90, 0)),
        moved(lathe([*chuck, (0, 0.066)], dark), (0.050, 0, 0.152), (0, 90, 0)),
        moved(cylinder(0.0215, 0.009, steel), (0.046, 0, 0.152), (0, 90, 0)),
        moved(rounded_box((0.040, 0.034, 0.110), 0.014, blue), (-0.024, 0, 0.086), (0, 12, 0)),
        moved(rounded_box((0.094, 0.064, 0.036), 0.008, dark), (-0.020, 0, 0.018)),
        moved(rounded_box((0.018, 0.016, 0.026), 0.006, (186, 44, 34)), (0.004, 0, 0.108)),
        moved(cylinder(0.013, 0.008, (186, 44, 34)), (-0.030, -0.026, 0.160), (90, 0, 0)),
    )


def _duck() -> Mesh:
    yellow, orange = (218, 178, 44), (206, 100, 34)
    wing = (0.029, 0.009, 0.018)
    return merge(
        moved(ellipsoid((0.054, 0.039, 0.033), yellow), (0, 0, 0.036)),
        moved(ellipsoid((0.024, 0.022, 0.012), yellow), (-0.050, 0, 0.056), (0, 38, 0)),
        moved(ellipsoid((0.022, 0.021, 0.028), yellow), (0.026, 0.004, 0.064)),
        moved(ellipsoid((0.028, 0.026, 0.025), yellow), (0.033, 0.006, 0.093)),
        moved(ellipsoid((0.018, 0.014, 0.006), orange), (0.062, 0.012, 0.088), (0, 8, 12)),
        moved(ellipsoid(wing, (240, 226, 170)), (-0.008, 0.035, 0.042), (-12, 10, 0)),
        moved(ellipsoid(wing, (240, 226, 170)), (-0.008, -0.035, 0.042), (12, 10, 0)),
        moved(ellipsoid((0.004, 0.004, 0.005), DARK), (0.051, 0.024, 0.101)),
        moved(ellipsoid((0.004, 0.004, 0.005), DARK), (0.055, -0.007, 0.101)),
        cylinder(0.032, 0.010, orange),
    )


def _lamp() -> Mesh:
    red, grey, light = (158, 44, 52), (122, 124, 130), (232, 222, 190)
    arm = [(-0.030, 0.012, 0.010), (-0.046, 0.012, 0.100), (-0.044, 0.012, 0.112)]
    forearm = [(-0.045, -0.004, 0.106), (0.020, -0.004, 0.168)]
    shade = [(0, 0), (0.014, 0), (0.018, 0.022), (0.040, 0.062), (0.037, 0.062), (0.014, 0.024)]
    return merge(
        lathe([(0, 0), (0.054, 0), (0.054, 0.008), (0.046, 0.014), (0, 0.014)], red),
        moved(cylinder(0.007, 0.008, light), (0.030, 0.022, 0.011)),
        tube(arm, (0.007, 0.007, 0.007), grey),
        tube(forearm, (0.006, 0.006), grey),
        moved(cylinder(0.012, 0.030, grey), (-0.045, 0.019, 0.106), (90, 0, 0)),
        moved(lathe([*shade, (0, 0.022)], red), (0.010, -0.004, 0.178), (0, 142, 14)),
        moved(ellipsoid((0.014, 0.014, 0.018), light), (0.034, 0.002, 0.147), (0, 142, 14)),
    )


def turns_about_z(steps: int) -> Poses:
    """Rotations (n, 4, 4) about z by multiples of 2π / `steps`, the identity first."""
    return rigid(turns_in_plane(np.arange(steps) * (2 * np.pi / steps)), np.zeros(3))


def shape_model(object_id: int, name: str, mesh: Mesh) -> ObjectModel:
    """An object of that mesh; the bowl alone has symmetries."""
    diameter = mesh_diameter(mesh.vertices)
    return ObjectModel(
        object_id=object_id,
        name=name,
        mesh=mesh,
        proxy=build_proxy(mesh, PROXY_FACES, diameter),
        diameter=diameter,
        symmetries=turns_about_z(BOWL_STEPS if name == "bowl" else 1),
        holistic_size=holistic_size(mesh.vertices),
        local_size=local_size(diameter),
    )


@lru_cache(maxsize=1)
def demo_objects() -> dict[int, ObjectModel]:
    """The eight models by object id (1…8, in alphabetical order of their names), built once."""
    shapes = (_bear, _bowl, _camera, _can, _drill, _duck, _lamp, _rabbit)
    return {
        number: shape_model(number, shape.__name__.removeprefix("_"), centred(shape()))
        for number, shape in enumerate(shapes, start=1)
    }
