"""RGB-D views of an object from many viewpoints (stage 0), and their files.

The paper places its cameras like equal charges at rest on a sphere (Thomson problem). Directions
are unit vectors in object coordinates; angles are radians.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le
from jaxtyping import Bool, Float, UInt16

from hlp.arrays import CameraMatrix, Points, Poses, StoredDepth, Values
from hlp.errors import ConfigError, DataError, MissingFileError
from hlp.files import write_array
from hlp.geometry import rigid
from hlp.progress import Progress
from hlp.records import MILLIMETRES_PER_METRE, ObjectModel, Views
from hlp.rendering import opengl, rasterizer
from hlp.rendering.shading import random_light
from hlp.settings import Count, Doc, Positive, Settings, SettingsError
from hlp.threads import ThreadTeam

_MIRROR = np.array([1.0, 1.0, -1.0])
# Below this distance from the pole the object's +z has no direction in the image.
_POLE = 1e-6


def thomson(count: int, seed: int) -> Points:
    """`count` directions over the whole sphere at a minimum of the Coulomb energy.

    Starts from uniform random directions and finds a local minimum. Its energy is within 0.01 % of
    the best known (Wales & Ulker 2006) for the counts tested, 2 to 400.
    """
    return _relax(_random_directions(count, seed), mirrored=False)


def hemisphere(count: int, seed: int) -> Points:
    """`count` directions on the upper half (z > 0) of the sphere, as evenly as `thomson`'s.

    Each charge has a mirror image below the equator, so this is the upper half of a symmetric
    solution for 2·count charges: the lowest ring stays half a spacing above the equator.
    """
    start = _random_directions(count, seed)
    start[:, 2] = np.abs(start[:, 2])
    return _relax(start, mirrored=True)


def view_rotations(viewpoints: Points, in_plane: Values) -> Float[np.ndarray, "nm 3 3"]:
    """Rotations `cam_obj` (n·m, 3, 3), viewpoint-major, of cameras at `viewpoints` (n, 3).

    The camera looks from each viewpoint at the object's centre; the object's +z points up in the
    image (at the poles its +y does), then the image is turned about the optical axis by each
    angle of `in_plane` (m,) in rad (positive takes the image's x axis towards its y axis).
    """
    backward = viewpoints / np.linalg.norm(viewpoints, axis=-1, keepdims=True)
    up = np.array([0.0, 0.0, 1.0]) - backward[:, 2:] * backward
    at_pole = np.linalg.norm(up, axis=-1) < _POLE
    up[at_pole] = np.array([0.0, 1.0, 0.0]) - backward[at_pole, 1:2] * backward[at_pole]
    y_axis = -up / np.linalg.norm(up, axis=-1, keepdims=True)
    z_axis = -backward
    upright = np.stack([np.cross(y_axis, z_axis), y_axis, z_axis], axis=1)
    turns = turns_in_plane(in_plane)
    return np.asarray(np.einsum("mij,njk->nmik", turns, upright).reshape(-1, 3, 3))


def turns_in_plane(angles: Values) -> Float[np.ndarray, "n 3 3"]:
    """Rotations about the optical axis, from the image's x axis towards its y axis."""
    turns = np.zeros((len(angles), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(angles)
    turns[:, 1, 0], turns[:, 2, 2] = np.sin(angles), 1.0
    turns[:, 0, 1] = -turns[:, 1, 0]
    return turns


def _random_directions(count: int, seed: int) -> Points:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))


def _relax(start: Points, mirrored: bool) -> Points:
    """Nearest minimum of the Coulomb energy, by L-BFGS over unnormalised vectors.

    The energy depends on the directions only, so the sphere needs no constraint.
    """
    if len(start) == 1 and not mirrored:
        return start  # a single charge is at rest anywhere

    def energy(flat: Values) -> tuple[float, Values]:
        vectors = flat.reshape(-1, 3)
        norms = np.linalg.norm(vectors, axis=1, keepdims=True)
        points = vectors / norms
        own = np.eye(len(points), dtype=bool)
        value, slope = _repulsion(points, points, own)
        if mirrored:
            below, below_slope = _repulsion(points, points * _MIRROR, np.zeros_like(own))
            value, slope = value + below, slope + below_slope
        tangent = slope - (slope * points).sum(axis=1, keepdims=True) * points
        return value, (tangent / norms).ravel()

    from scipy.optimize import minimize  # only learning needs it, and it is slow to import

    limits = {"maxiter": 1000, "maxfun": 2000, "ftol": 1e-11, "gtol": 1e-6}
    result = minimize(energy, start.ravel(), jac=True, method="L-BFGS-B", options=limits)
    points = result.x.reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    if mirrored:
        # A charge and its mirror image are equivalent: a step may have swapped them.
        points[:, 2] = np.abs(points[:, 2])
    return np.asarray(points)


def _repulsion(
    points: Points, charges: Points, excluded: Bool[np.ndarray, "n n"]
) -> tuple[float, Points]:
    """Half the energy of all points and charges, and its gradient with respect to the points.

    Half, because each pair occurs twice (charges are the points or their mirror images).
    """
    squared = np.maximum(2.0 - 2.0 * points @ charges.T, 1e-12)
    inverse = 1.0 / np.sqrt(squared)
    inverse[excluded] = 0.0
    cubed = inverse**3
    slope = cubed @ charges - cubed.sum(axis=1, keepdims=True) * points
    return float(inverse.sum() / 2.0), slope


_COVERAGES = {"hemisphere": hemisphere, "sphere": thomson}
_DEPTH_UNIT = 1e-4  # m
_FILES = ("rgb", "depth", "poses_cam_obj", "camera_matrix")


@dataclass(frozen=True)
class ViewsSettings(Settings):
    """Config group `rendering`: which renderer, from where, and how large.

    Views are viewpoints × in-plane angles: 240 × 15 = 3600 (P: 3600; the split is ours), over all
    poses. Twice the steps between views, 13° and 24°, cost no recall on three recordings of other
    cameras, since local patches vote within 18° and the refinement recovers from 30°.
    """

    name: Annotated[
        Literal["auto", "numba", "pyrender"],
        Doc("the renderer; auto is numba, which runs everywhere (D)"),
    ] = "auto"
    viewpoints: Annotated[Count, Le(20_000), Doc("number of viewing directions (D)")] = 240
    coverage: Annotated[
        Literal["hemisphere", "sphere"],
        Doc("where the viewpoints are; hemisphere: objects are seen from above only (D)"),
    ] = "sphere"
    in_plane_min_deg: Annotated[float, Doc("smallest in-plane angle (D)")] = -180.0
    in_plane_max_deg: Annotated[float, Doc("largest in-plane angle (D)")] = 156.0
    in_plane_steps: Annotated[
        Count, Le(3600), Doc("number of in-plane angles, 24° apart by default (D)")
    ] = 15
    distance_mm: Annotated[
        Positive, Doc("from camera to object centroid; typical of LINEMOD (D)")
    ] = 800.0
    focal_px: Annotated[
        Positive, Doc("LINEMOD's focal length; reduced if the object does not fit in the crop (D)")
    ] = 572.0
    size_px: Annotated[
        int, Ge(8), Le(1024), Doc("side of the square crop around the object (D)")
    ] = 128

    def __post_init__(self) -> None:
        """Raise SettingsError naming the key that is out of range."""
        super().__post_init__()
        if self.in_plane_max_deg < self.in_plane_min_deg:
            problem = f"is {self.in_plane_max_deg}: it must be at least in_plane_min_deg, "
            raise SettingsError("in_plane_max_deg", problem + str(self.in_plane_min_deg))


def render_views(model: ObjectModel, settings: ViewsSettings, seed: int, threads: int = 1) -> Views:
    """Views of the full mesh, viewpoint-major, each under a different random light.

    The centroid lies on the optical axis at `distance_mm`, the principal point is the crop's
    centre. The focal length is `focal_px`, or less where the object would not fit in the crop.
    The same seed gives the same views, whatever the number of threads. Raises ValueError if the
    object is larger than its distance, RuntimeError if pyrender is asked for and cannot run.
    """
    poses = _poses(model, settings, seed)
    camera_matrix = _crop_camera(model, settings)
    rng = np.random.default_rng(seed)
    lights = [random_light(rng) for _ in poses]
    shape = (settings.size_px, settings.size_px)
    rgb = np.zeros((len(poses), *shape, 3), dtype=np.uint8)
    depth = np.zeros((len(poses), *shape), dtype=np.float32)
    by_opengl = settings.name == "pyrender"
    render = opengl.render_rgbd if by_opengl else rasterizer.render_rgbd
    bar = Progress(None, f"views of {model.name}", len(poses), unit="view")

    def draw(index: int) -> None:
        pose, light = poses[index], lights[index]
        rgb[index], depth[index] = render(model.mesh, pose, camera_matrix, shape, light)
        bar.update()

    with bar:
        ThreadTeam(1 if by_opengl else threads).map(draw, len(poses))
    return Views(model.object_id, rgb, depth, poses, camera_matrix)


def save_views(folder: Path, views: Views) -> None:
    """Write views as .npy files into `folder`, which is created if it does not exist.

    Depth is stored in steps of 0.1 mm (uint16), so it is rounded by up to 0.05 mm. The object's id
    is not stored: objects of any id can share the views of one mesh. Raises ValueError on depth
    beyond 6.5 m, which would not fit.
    """
    folder.mkdir(parents=True, exist_ok=True)
    steps = (_depth_steps(views, view) for view in range(len(views)))
    content = [views.rgb], steps, [views.poses_cam_obj], [views.camera_matrix]
    shapes = views.rgb.shape, views.depth.shape, views.poses_cam_obj.shape, (3, 3)
    for name, shape, parts in zip(_FILES, shapes, content, strict=True):
        write_array(folder / f"{name}.npy", shape, parts)


def _depth_steps(views: Views, view: int) -> UInt16[np.ndarray, "s s"]:
    steps = np.rint(views.depth[view] / _DEPTH_UNIT)
    if not (steps.min() >= 0 and steps.max() <= np.iinfo(np.uint16).max):
        raise ConfigError(
            f"depth of object {views.object_id} lies outside 0 to 6.5535 m; "
            "use a smaller rendering.distance_mm"
        )
    return steps.astype(np.uint16)


def load_views(folder: Path, object_id: int) -> Views:
    """Views written by `save_views`, as those of the object `object_id`.

    Images stay on disk (memory-mapped, read-only) until they are asked for. Raises
    FileNotFoundError if a file is missing, ValueError if one is damaged or does not fit the others;
    both name the file.
    """
    rgb, steps, poses, camera_matrix = (_load(folder / f"{name}.npy") for name in _FILES)
    if not len(rgb) == len(steps) == len(poses):
        raise DataError(
            f"{folder} holds {len(rgb)} colour, {len(steps)} depth images and {len(poses)} poses; "
            "delete the folder to render it again"
        )
    depth = StoredDepth(steps, _DEPTH_UNIT)
    return Views(object_id, rgb, depth, np.array(poses), np.array(camera_matrix))


def _load(file: Path) -> np.ndarray:
    if not file.is_file():
        raise MissingFileError(f"{file} is missing; render the object's views first")
    try:
        return np.asarray(np.load(file, mmap_mode="r", allow_pickle=False))
    except (ValueError, EOFError) as error:
        message = f"{file} is damaged ({error}); delete its folder to render again"
        raise DataError(message) from error


def _poses(model: ObjectModel, settings: ViewsSettings, seed: int) -> Poses:
    viewpoints = _COVERAGES[settings.coverage](settings.viewpoints, seed)
    least, most = settings.in_plane_min_deg, settings.in_plane_max_deg
    angles = np.linspace(least, most, settings.in_plane_steps)
    rotations = view_rotations(viewpoints, np.deg2rad(angles))
    on_axis = np.array([0.0, 0.0, settings.distance_mm / 1000.0])
    return rigid(rotations, on_axis - rotations @ model.centroid)


def _crop_camera(model: ObjectModel, settings: ViewsSettings) -> CameraMatrix:
    """Camera of a crop in which the sphere about the centroid that encloses the object fits."""
    distance = settings.distance_mm / 1000.0
    radius = float(np.linalg.norm(model.mesh.vertices - model.centroid, axis=1).max())
    if distance <= radius + rasterizer.NEAR:
        raise ConfigError(
            f"rendering.distance_mm is {settings.distance_mm:g}, but {model.name} reaches "
            f"{radius * MILLIMETRES_PER_METRE:.0f} mm from its centre: the camera would be inside"
        )
    # One pixel is left free on each side, so that patches at the silhouette include its edge.
    fitting = (settings.size_px / 2 - 1) * np.sqrt(distance**2 - radius**2) / radius
    focal = min(settings.focal_px, fitting)
    centre = (settings.size_px - 1) / 2
    return np.array([[focal, 0.0, centre], [0.0, focal, centre], [0.0, 0.0, 1.0]])
