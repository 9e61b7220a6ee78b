"""Frozen hand-overs between the stages.

Everything inside HLP is in metres and radians; millimetres exist only at BOP's border and in text
for people. `pose_cam_obj` (4, 4) maps object coordinates to camera coordinates; the camera looks
along +z, x to the right, y down (OpenCV's convention). Pixel centres have integer coordinates.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in object coordinates, metres. Two are equal only if they are one."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    colors: UInt8[np.ndarray, "v 3"]
    normals: Float[np.ndarray, "v 3"]


@dataclass(frozen=True)
class ObjectModel:
    """What is known of an object before any image is seen: its CAD model and its sizes.

    `mesh` is the full model, `proxy` the decimated one that the refiner renders.
    `diameter` is the largest distance between two vertices (m). `symmetries` are the rigid motions
    (n, 4, 4) that leave the object as it is, the identity first (continuous ones discretised).
    `holistic_size` and `local_size` are the metric sides (m) of its patches (paper, Eq. 1).
    """

    object_id: int
    name: str
    mesh: Mesh
    proxy: Mesh
    diameter: float
    symmetries: Float[np.ndarray, "n 4 4"]
    holistic_size: float
    local_size: float

    @cached_property  # a millisecond for a scanned mesh, and wanted many times a frame
    def centroid(self) -> Float[np.ndarray, "3"]:
        """Centre of the bounding box, object coordinates (m): what patches vote for."""
        low, high = self.mesh.vertices.min(axis=0), self.mesh.vertices.max(axis=0)
        return np.asarray((low + high) / 2, dtype=np.float64)


@dataclass(frozen=True)
class Target:
    """One object that should be found in a frame, with its true pose.

    `visible_fraction` is nan where the data set does not say.
    """

    object_id: int
    pose_cam_obj: Float[np.ndarray, "4 4"]
    visible_fraction: float = float("nan")


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
        return f"{self.scene_id:06d}_{self.frame_id:06d}"


@dataclass(frozen=True)
class Views:
    """Rendered RGB-D views of one object, all at image centre and of one size (stage 0).

    The object's centroid lies on the optical axis, so each crop is centred on the principal point
    of the shared `camera_matrix` (of the crop). `depth` is in metres, 0 where no object is.
    """

    object_id: int
    rgb: UInt8[np.ndarray, "n s s 3"]
    depth: Float[np.ndarray, "n s s"]
    poses_cam_obj: Float[np.ndarray, "n 4 4"]
    camera_matrix: Float[np.ndarray, "3 3"]

    def __len__(self) -> int:
        return len(self.poses_cam_obj)


@dataclass(frozen=True)
class LocalPatches:
    """Local RGB-D patches on a common grid (stage 2), before any encoder sees them.

    `color` in 0…255, without channels where nobody looks at it; `depth` along the centre's viewing
    ray, in units of half the patch's metric size relative to the centre's, clamped to [-1, 1];
    `valid` is False where depth is missing or beyond the clamp.
    `points_cam` are the patch centres in camera coordinates (m), `pixels` the same as (x, y).
    """

    color: UInt8[np.ndarray, "n p p c"]
    depth: Float[np.ndarray, "n p p"]
    valid: Bool[np.ndarray, "n p p"]
    points_cam: Float[np.ndarray, "n 3"]
    pixels: Float[np.ndarray, "n 2"]

    def __len__(self) -> int:
        return len(self.points_cam)


@dataclass(frozen=True)
class Region:
    """Candidate region of one object in one frame (stage 1).

    `centers` are the window centres (x, y) in pixels, `probabilities` that of the object at each,
    `mask` the union of the accepted windows.
    """

    object_id: int
    centers: Float[np.ndarray, "n 2"]
    probabilities: Float[np.ndarray, "n"]
    mask: Bool[np.ndarray, "h w"]


@dataclass(frozen=True)
class Codebook:
    """Features of the local patches of all views of one object, each with what it votes for.

    `rotations_cam_obj` of the view, seen along the optical axis (allocentric);
    `points_obj` the patch centre in object coordinates (m): the offset to the centroid follows.
    """

    object_id: int
    features: Float[np.ndarray, "m d"]
    rotations_cam_obj: Float[np.ndarray, "m 3 3"]
    points_obj: Float[np.ndarray, "m 3"]
    feature_scale: float


@dataclass(frozen=True)
class Matches:
    """k nearest codebook entries of each query, nearest first; distances are Euclidean."""

    indices: Int[np.ndarray, "n k"]
    distances: Float[np.ndarray, "n k"]


@dataclass(frozen=True)
class Votes:
    """Votes for the object's centroid and rotation in the camera's frame.

    `patches` names the local patch that cast each vote, `pixels` its centre (x, y).
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
    """Coarse poses of one object in one frame, best first; `support` is the weight behind each."""

    poses_cam_obj: Float[np.ndarray, "m 4 4"]
    support: Float[np.ndarray, "m"]

    def __len__(self) -> int:
        return len(self.support)


@dataclass(frozen=True)
class Refinement:
    """What a refiner makes of one coarse pose: the pose, and how many iterations it took."""

    pose_cam_obj: Float[np.ndarray, "4 4"]
    iterations: int


@dataclass(frozen=True)
class PoseEstimate:
    """The answer for one object in one frame. `pose_cam_obj` is None where none was found.

    `score` in [0, 1], higher is surer; `seconds` is wall time per stage.
    """

    scene_id: int
    frame_id: int
    object_id: int
    pose_cam_obj: Float[np.ndarray, "4 4"] | None
    score: float
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class TargetScore:
    """Errors and verdicts of one target. A missing pose has infinite errors and is wrong.

    `add_error` (m) is ADD, or ADI for objects the policy calls symmetric. The three recalls are
    BOP's, averaged over its thresholds; nan where not computed. `cause` is why a target was missed
    (evaluation.waterfall), empty where it was not or nobody asked.
    """

    scene_id: int
    frame_id: int
    object_id: int
    found: bool
    visible_fraction: float
    add_error: float
    rotation_error: float
    translation_error: float
    box_iou: float
    add_correct: bool
    pose_correct: bool
    box_correct: bool
    mssd_recall: float = float("nan")
    mspd_recall: float = float("nan")
    vsd_recall: float = float("nan")
    cause: str = ""
