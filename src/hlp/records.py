"""Frozen records that the stages pass to each other.

Everything inside HLP is in metres and radians; millimetres occur only in BOP's files, in keys that
end in `_mm` and in output for people. `pose_cam_obj` (4, 4) maps object coordinates to camera
coordinates; the camera looks along +z, x to the right, y down (OpenCV's convention). Pixel centres
have integer coordinates.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from hlp.arrays import StoredDepth

MILLIMETRE, MILLIMETRES_PER_METRE = 1e-3, 1000.0  # the first in metres


@dataclass(frozen=True, eq=False)
class Texture:
    """An image laid on a mesh, and the place of each of the mesh's v vertices in it.

    `uv` are OpenGL's texture coordinates: u grows from 0 at the left border to 1 at the right one,
    v from 0 at the bottom to 1 at the top. Outside of 0…1 the image repeats.
    """

    image: UInt8[np.ndarray, "h w 3"]
    uv: Float[np.ndarray, "v 2"]


@dataclass(frozen=True, eq=False)
class ColorGrid:
    """An object's surface colours in cubic cells of side `cell` (m), the first at `corner` (m)."""

    colors: UInt8[np.ndarray, "x y z 3"]
    corner: Float[np.ndarray, "3"]
    cell: float


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in object coordinates (m). Meshes are compared by identity.

    `colors` of a textured mesh are the texture's at the vertices. `colored` is False if the file
    states no colours, or all are one grey: then `colors` mean nothing. `color_grid` are the colours
    to be read at any point, if they were computed when the object was learnt.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    colors: UInt8[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]
    texture: Texture | None = None
    colored: bool = True
    color_grid: ColorGrid | None = None


@dataclass(frozen=True)
class ObjectModel:
    """An object as the method knows it: its CAD model, symmetries and patch sizes.

    `mesh` is the full model, `proxy` the decimated one that the refiner renders. `diameter` is the
    largest distance between two vertices (m). `symmetries` are the rigid motions (n, 4, 4) that map
    the object onto itself, the identity first; continuous symmetries are discretised. The motions
    `near_symmetries` (k, 4, 4), without the identity, map its shape nearly onto itself, but not its
    colours: depth hardly tells a pose T from T·S. `holistic_size` and `local_size` are the metric
    sides (m) of its patches (paper, Eq. 1).
    """

    object_id: int
    name: str
    mesh: Mesh
    proxy: Mesh
    diameter: float
    symmetries: Float[np.ndarray, "n 4 4"]
    holistic_size: float
    local_size: float
    near_symmetries: Float[np.ndarray, "k 4 4"] = field(default_factory=lambda: np.empty((0, 4, 4)))

    @cached_property  # takes a millisecond for a scanned mesh and is used often
    def centroid(self) -> Float[np.ndarray, "3"]:
        """Centre of the bounding box in object coordinates (m); patches vote for its position."""
        low, high = self.mesh.vertices.min(axis=0), self.mesh.vertices.max(axis=0)
        return np.asarray((low + high) / 2, dtype=np.float64)


@dataclass(frozen=True)
class Target:
    """An object to be found in a frame, with its true pose; `visible_fraction`: nan if unknown."""

    object_id: int
    pose_cam_obj: Float[np.ndarray, "4 4"]
    visible_fraction: float = float("nan")


def frame_key(scene_id: int, frame_id: int) -> str:
    """Name of a frame in files and logs, e.g. `000006_000012`."""
    return f"{scene_id:06d}_{frame_id:06d}"


def parse_frame_key(key: str) -> tuple[int, int]:
    """Scene and frame of a key. Raises ValueError for a text that `frame_key` does not write."""
    scene, _, frame = key.partition("_")
    if not (scene.isdecimal() and frame.isdecimal()) or key != frame_key(int(scene), int(frame)):
        raise ValueError(f"{key!r} is not a frame key: it must look like 000006_000012")
    return int(scene), int(frame)


@dataclass(frozen=True)
class Frame:
    """One RGB-D image. `depth` in metres, 0 where missing; `camera_matrix` in pixels."""

    scene_id: int
    frame_id: int
    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float[np.ndarray, "h w"]
    camera_matrix: Float[np.ndarray, "3 3"]
    targets: tuple[Target, ...] = ()

    @property
    def key(self) -> str:
        """Name of the frame in files and logs, e.g. `000006_000012`."""
        return frame_key(self.scene_id, self.frame_id)


@dataclass(frozen=True)
class CameraImage:
    """One RGB-D image as a camera delivers it.

    `rgb` has red first. `depth` is in metres along the optical axis, registered to the colour, 0 or
    NaN where missing. `camera_matrix` is in pixels. `name` is what the image is called in answers,
    `captured` when it was taken (s since 1970; None: unknown).

    Examples:
        >>> CameraImage(rgb, depth, camera_matrix, name="left").name
        'left'
    """

    rgb: UInt8[np.ndarray, "h w 3"]
    depth: Float[np.ndarray, "h w"]
    camera_matrix: Float[np.ndarray, "3 3"]
    name: str = ""
    captured: float | None = None


@dataclass(frozen=True)
class Views:
    """Rendered RGB-D views of one object, square and of one size (stage 0).

    The object's centroid lies on the optical axis, so it is seen at the principal point of
    `camera_matrix`, which all views share. `depth` is in metres, 0 outside the object.
    """

    object_id: int
    rgb: UInt8[np.ndarray, "n s s 3"]
    depth: Float[np.ndarray, "n s s"] | StoredDepth
    poses_cam_obj: Float[np.ndarray, "n 4 4"]
    camera_matrix: Float[np.ndarray, "3 3"]

    def __len__(self) -> int:
        return len(self.poses_cam_obj)


@dataclass(frozen=True)
class LocalPatches:
    """Local RGB-D patches, resized to p x p pixels: the encoders' input (stage 2).

    `color` is in 0…255; it has no channels (c = 0) if the encoder does not use colour. `depth` is
    measured along the viewing ray of the patch centre, relative to the centre's depth, in units of
    half the patch's metric size, and clamped to [-1, 1]. `valid` is False where depth is missing or
    clamped. `points_cam` (m) and `pixels` (x, y) are the patch centres in camera and image.
    """

    color: UInt8[np.ndarray, "n p p c"]
    depth: Float[np.ndarray, "n p p"]
    valid: Bool[np.ndarray, "n p p"]
    points_cam: Float[np.ndarray, "n 3"]
    pixels: Float[np.ndarray, "n 2"]

    def __len__(self) -> int:
        return len(self.points_cam)

    def __getitem__(self, rows: Int[np.ndarray, "m"] | slice) -> "LocalPatches":
        """The patches of some rows, in their order."""
        return LocalPatches(*(values[rows] for values in vars(self).values()))


@dataclass(frozen=True)
class Region:
    """Candidate region of one object in one frame (stage 1).

    `centers` are the window centres (x, y) in pixels, `probabilities` the classifier's probability
    of the object in each window, `mask` the candidate region.
    """

    object_id: int
    centers: Float[np.ndarray, "n 2"]
    probabilities: Float[np.ndarray, "n"]
    mask: Bool[np.ndarray, "h w"]


@dataclass(frozen=True)
class Codebook:
    """Features of local patches of an object's views, with what each patch votes for.

    `rotations_cam_obj` are the rotations of the views, in which the object lies on the optical axis
    (allocentric). `points_obj` are the patch centres in object coordinates (m), from which the
    offsets to the centroid follow. `feature_scale` is the unit of feature distances.
    """

    object_id: int
    features: Float[np.ndarray, "m d"]
    rotations_cam_obj: Float[np.ndarray, "m 3 3"]
    points_obj: Float[np.ndarray, "m 3"]
    feature_scale: float


@dataclass(frozen=True)
class Matches:
    """The k nearest codebook entries of each query, nearest first; Euclidean distances."""

    indices: Int[np.ndarray, "n k"]
    distances: Float[np.ndarray, "n k"]


@dataclass(frozen=True)
class Votes:
    """Votes for the object's centroid (m) and rotation in the camera's frame.

    `patches` is the index of the local patch that cast a vote, `pixels` that patch's centre (x, y).
    """

    centroids_cam: Float[np.ndarray, "v 3"]
    rotations_cam_obj: Float[np.ndarray, "v 3 3"]
    weights: Float[np.ndarray, "v"]
    patches: Int[np.ndarray, "v"]
    pixels: Float[np.ndarray, "v 2"]

    def __len__(self) -> int:
        return len(self.weights)


@dataclass(frozen=True)
class Hypotheses:
    """Coarse poses of an object in a frame, best first; `support` is the weight of their votes."""

    poses_cam_obj: Float[np.ndarray, "m 4 4"]
    support: Float[np.ndarray, "m"]

    def __len__(self) -> int:
        return len(self.support)


@dataclass(frozen=True)
class PoseEstimate:
    """The estimate for one object in one frame. `pose_cam_obj` is None if none was found.

    `score` is in [0, 1], higher is more certain; `seconds` is wall time by stage.
    """

    scene_id: int
    frame_id: int
    object_id: int
    pose_cam_obj: Float[np.ndarray, "4 4"] | None
    score: float
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class TargetScore:
    """Errors of one target and whether it counts as found; the defaults are those without a pose.

    `add_error` (m) is ADD, or ADD-S for objects that count as symmetric. The three recalls are
    BOP's, averaged over its thresholds; nan if not computed. `cause` is why a target was missed
    (evaluation.waterfall), empty if that was not computed. `score` is the estimate's: the
    probability of `add_s_correct`, that ADD-S is below the limit.
    """

    scene_id: int
    frame_id: int
    object_id: int
    found: bool
    visible_fraction: float
    add_error: float = np.inf
    rotation_error: float = np.inf
    translation_error: float = np.inf
    box_iou: float = 0.0
    add_correct: bool = False
    pose_correct: bool = False
    box_correct: bool = False
    mssd_recall: float = np.nan
    mspd_recall: float = np.nan
    vsd_recall: float = np.nan
    cause: str = ""
    score: float = np.nan
    add_s_correct: bool = False
