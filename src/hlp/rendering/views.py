"""RGB-D views of an object from many viewpoints (stage 0), and their files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le
from jaxtyping import Float
from tqdm import tqdm

from hlp.arrays import Poses
from hlp.errors import ConfigError, DataError, MissingFileError
from hlp.files import write_array
from hlp.geometry import rigid
from hlp.records import MILLIMETRES_PER_METRE, ObjectModel, Views
from hlp.rendering import opengl, rasterizer
from hlp.rendering.light import random_light
from hlp.rendering.viewpoints import hemisphere, thomson, view_rotations
from hlp.settings import Doc, Positive, Settings, SettingsError
from hlp.thread_team import ThreadTeam

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
    viewpoints: Annotated[int, Ge(1), Le(20_000), Doc("number of viewing directions (D)")] = 240
    coverage: Annotated[
        Literal["hemisphere", "sphere"],
        Doc("where the viewpoints are; hemisphere: objects are seen from above only (D)"),
    ] = "sphere"
    in_plane_min_deg: Annotated[float, Doc("smallest in-plane angle (D)")] = -180.0
    in_plane_max_deg: Annotated[float, Doc("largest in-plane angle (D)")] = 156.0
    in_plane_steps: Annotated[
        int, Ge(1), Le(3600), Doc("number of in-plane angles, 24° apart by default (D)")
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


def render_views(
    model: ObjectModel, settings: ViewsSettings, seed: int, progress: bool = True, threads: int = 1
) -> Views:
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
    bar = tqdm(total=len(poses), desc=f"views of {model.name}", disable=None if progress else True)

    def draw(index: int) -> None:
        rgb[index], depth[index] = render(
            model.mesh, poses[index], camera_matrix, shape, lights[index]
        )
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
    steps = np.rint(views.depth / _DEPTH_UNIT)
    if steps.size and not (steps.min() >= 0 and steps.max() <= np.iinfo(np.uint16).max):
        raise ConfigError(
            f"depth of object {views.object_id} lies outside 0 to 6.5535 m; "
            "use a smaller rendering.distance_mm"
        )
    arrays = views.rgb, steps.astype(np.uint16), views.poses_cam_obj, views.camera_matrix
    folder.mkdir(parents=True, exist_ok=True)
    for name, array in zip(_FILES, arrays, strict=True):
        write_array(folder / f"{name}.npy", array)


def load_views(folder: Path, object_id: int) -> Views:
    """Views written by `save_views`, as those of the object `object_id`.

    `rgb` stays on disk (memory-mapped, read-only). Raises FileNotFoundError if a file is missing,
    ValueError if one is damaged or does not fit the others; both name the file.
    """
    rgb, steps, poses, camera_matrix = (_load(folder / f"{name}.npy") for name in _FILES)
    if not len(rgb) == len(steps) == len(poses):
        raise DataError(
            f"{folder} holds {len(rgb)} colour, {len(steps)} depth images and {len(poses)} poses; "
            "delete the folder to render it again"
        )
    depth = np.multiply(steps, np.float32(_DEPTH_UNIT), dtype=np.float32)
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


def _crop_camera(model: ObjectModel, settings: ViewsSettings) -> Float[np.ndarray, "3 3"]:
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
