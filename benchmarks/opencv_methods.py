"""OpenCV's LINEMOD and PPF: coarse poses of one object in an image, for `accuracy_vs_seconds.py`.

- LINEMOD: templates are rendered from HLP's range of views and the recording's range of distances,
  as in Hinterstoisser et al. (ACCV 2012). A match becomes a coarse pose: the template's rotation,
  at the distance that fits the depth under it best.
- PPF: point pair features (Drost et al., CVPR 2010), sampled at a twentieth of the diameter, and
  OpenCV's ICP with the points near a pose.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import trimesh

from hlp.geometry import back_project, rigid
from hlp.records import Frame, Hypotheses, ObjectModel
from hlp.rendering.rasterizer import render_rgbd
from hlp.rendering.shading import FRONTAL_LIGHT
from hlp.rendering.views import ViewsSettings, hemisphere, thomson, view_rotations

_THRESHOLD = 60.0  # percent of a template's features
_MARGIN = 8  # px around a template
_PIXELS = 200  # of a template, whose depth is compared
_HYPOTHESES, _FURTHER, _IN_A_CELL = 60, 15, 4  # coarse poses; for each further instance; of 16 px
_SAMPLED, _SAMPLES = 0.05, 5000  # of the diameter: distance of PPF's points; of a mesh, for ICP
_STEP = 2  # px between the points of the scene
_REFERENCES = 1 / 5, 2000  # of the scene's points: PPF's reference points, and at most so many
_NEARER, _FARTHER = 0.8, 1.2  # than the recording's distances: PPF's points
_REFINED, _APART = 5, 0.3  # PPF's poses for each instance; of the diameter, between instances

Poses = list[np.ndarray]
contrib: Any = cv2  # its types leave the contributed modules out


@dataclass(frozen=True)
class Views:
    """Rotations (n, 3, 3) and distances (m) of templates."""

    rotations: np.ndarray
    distances: np.ndarray

    @classmethod
    def of(cls, rendering: ViewsSettings, frames: Sequence[Frame], viewpoints: int) -> "Views":
        """Those of HLP's views, 15° apart in the image; distances of the targets, 10 % apart."""
        above = rendering.coverage == "hemisphere"
        directions = (hemisphere if above else thomson)(viewpoints, 0)
        low, high = rendering.in_plane_min_deg, rendering.in_plane_max_deg
        turns = np.radians(np.arange(low, high + 1 if above else low + 360, 15))
        seen = [target.pose_cam_obj[2, 3] for frame in frames for target in frame.targets]
        steps = int(np.ceil(np.log(max(seen) / min(seen)) / np.log(1.1))) + 1
        return cls(view_rotations(directions, turns), np.geomspace(min(seen), max(seen), steps))


@dataclass(frozen=True)
class Template:
    """A view: rotation, the centroid's depth and its place in the template, pixels and depths."""

    rotation: np.ndarray
    distance: float
    centroid: np.ndarray
    pixels: np.ndarray
    depths: np.ndarray


class Linemod:
    """`cv2.linemod` with templates of one object."""

    def __init__(self, model: ObjectModel, camera: np.ndarray, views: Views) -> None:
        self.detector, self.model = contrib.linemod.getDefaultLINEMOD(), model
        self.templates: list[Template] = []
        for distance in views.distances:
            for rotation in views.rotations:
                self._add(camera, rotation, float(distance))

    def _add(self, camera: np.ndarray, rotation: np.ndarray, distance: float) -> None:
        model = self.model
        side = int(1.1 * model.diameter / distance * camera[0, 0]) + 2 * _MARGIN
        own = camera.copy()
        own[:2, 2] = (side - 1) / 2
        pose = rigid(rotation, np.array([0.0, 0.0, distance]) - rotation @ model.centroid)
        rgb, depth = render_rgbd(model.mesh, pose, own, (side, side), FRONTAL_LIGHT)
        mask = (depth > 0.0).astype(np.uint8) * 255
        number, box = self.detector.addTemplate(images_of(rgb, depth), "object", mask)
        if number < 0:  # too few features
            return
        assert number == len(self.templates)
        y, x = np.nonzero(depth)
        chosen = np.linspace(0, len(x) - 1, _PIXELS).astype(int)
        pixels = np.column_stack([x, y])[chosen] - box[:2]
        centroid = own[:2, 2] - box[:2]
        depths = depth[y, x][chosen].astype(np.float64)
        self.templates.append(Template(rotation, distance, centroid, pixels, depths))

    def hypotheses(self, frame: Frame, instances: int) -> Hypotheses:
        """Coarse poses of the best matches, a few at each place."""
        matches, _ = self.detector.match(images_of(frame.rgb, frame.depth), _THRESHOLD)
        poses, support, at = [], [], Counter[tuple[int, ...]]()
        for match in matches:
            template = self.templates[match.template_id]
            place = np.array([match.x, match.y])
            cell = tuple((template.centroid + place).astype(int) // 16)
            at[cell] += 1
            if at[cell] > _IN_A_CELL:
                continue
            poses.append(self._pose(template, place, frame))
            support.append(match.similarity)
            if len(poses) == _HYPOTHESES + _FURTHER * (instances - 1):
                break
        return Hypotheses(np.array(poses).reshape(-1, 4, 4), np.array(support))

    def _pose(self, template: Template, place: np.ndarray, frame: Frame) -> np.ndarray:
        height, width = frame.depth.shape
        x, y = np.clip(template.pixels + place, 0, [width - 1, height - 1]).T
        seen = frame.depth[y, x]
        there = seen > 0
        apart = np.median(seen[there] - template.depths[there]) if there.any() else 0.0
        z = template.distance + apart
        centre = back_project(template.centroid + place, np.array(z), frame.camera_matrix)
        return rigid(template.rotation, centre - template.rotation @ self.model.centroid)


def images_of(rgb: np.ndarray, depth: np.ndarray) -> list[np.ndarray]:
    """Images as LINEMOD takes them: blue first, and millimetres."""
    return [np.ascontiguousarray(rgb[..., ::-1]), np.rint(depth * 1000).astype(np.uint16)]


class Ppf:
    """`cv2.ppf_match_3d` with one object."""

    def __init__(self, model: ObjectModel) -> None:
        self.model = model
        mesh = trimesh.Trimesh(model.mesh.vertices, model.mesh.faces, process=False)
        points, faces = trimesh.sample.sample_surface(mesh, _SAMPLES, seed=0)
        self.points = np.hstack([points, mesh.face_normals[faces]]).astype(np.float32)
        self.detector = contrib.ppf_match_3d.PPF3DDetector(_SAMPLED, _SAMPLED, 30)
        self.detector.trainModel(self._thinned(self.points))
        self.icp = contrib.ppf_match_3d.ICP(100, 0.005, 2.5, 6)

    def _thinned(self, points: np.ndarray) -> np.ndarray:
        """One point in each cube: the detector's own grid has as many cells along a thin side."""
        cubes = np.floor(points[:, :3] / (_SAMPLED * self.model.diameter)).astype(int)
        return points[np.sort(np.unique(cubes, axis=0, return_index=True)[1])]

    def hypotheses(self, scene: np.ndarray, instances: int) -> Hypotheses:
        """The poses with most votes among the points (n, 6) of a scene."""
        # Distances of the scene are parts of its extents.
        apart = _SAMPLED * self.model.diameter / float(np.ptp(scene[:, :3], axis=0).max())
        thinned, (share, most) = self._thinned(scene), _REFERENCES
        found = self.detector.match(thinned, min(share, most / len(thinned)), apart)
        found = sorted(found, key=lambda each: -each.numVotes)
        found = found[: _HYPOTHESES + _FURTHER * (instances - 1)]
        poses = np.array([each.pose for each in found]).reshape(-1, 4, 4)
        return Hypotheses(poses, np.array([float(each.numVotes) for each in found]))

    def poses(self, scene: np.ndarray, instances: int) -> Poses:
        """The first poses at so many places, after ICP with the points near them."""
        chosen: Poses = []
        for pose in self.hypotheses(scene, instances).poses_cam_obj[: _REFINED * instances]:
            centre = pose[:3, :3] @ self.model.centroid + pose[:3, 3]
            far = np.linalg.norm(scene[:, :3] - centre, axis=1)
            near = scene[far < 0.6 * self.model.diameter]
            if len(near) > 100:
                placed = contrib.ppf_match_3d.transformPCPose(self.points, pose)
                moved, _, by = self.icp.registerModelToScene(placed, near)
                pose = by @ pose if moved == 0 and np.isfinite(by).all() else pose
            if all(self._apart(pose, other) for other in chosen):
                chosen.append(pose)
        return chosen[:instances]

    def _apart(self, pose: np.ndarray, other: np.ndarray) -> bool:
        between = (pose - other)[:3, :3] @ self.model.centroid + (pose - other)[:3, 3]
        return float(np.linalg.norm(between)) > _APART * self.model.diameter


def scene_of(frame: Frame, views: Views) -> np.ndarray:
    """Points and normals (n, 6) of an image where its depth is in the range of distances."""
    depth = frame.depth[::_STEP, ::_STEP]
    low, high = views.distances[[0, -1]]
    y, x = np.nonzero((depth > _NEARER * low) & (depth < _FARTHER * high))
    pixels = _STEP * np.column_stack([x, y]).astype(np.float64)
    points = back_project(pixels, depth[y, x].astype(np.float64), frame.camera_matrix)
    _, with_normals = contrib.ppf_match_3d.computeNormalsPC3d(
        points.astype(np.float32), 12, True, (0.0, 0.0, 0.0)
    )
    return np.asarray(with_normals[np.isfinite(with_normals).all(axis=1)])
