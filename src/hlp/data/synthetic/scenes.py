"""RGB-D frames of random, cluttered demo scenes with exact poses, rendered on demand."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from hlp.arrays import CameraMatrix, Image, Mask, Pose, Rgb, Vector
from hlp.data.dataset import DATASETS, Dataset, DataSettings, content_hash
from hlp.data.synthetic import layout
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.surfaces import draw_surroundings, random_surroundings
from hlp.fingerprints import source_digest
from hlp.geometry import inverse, project, transform
from hlp.records import Frame, ObjectModel, Target, frame_key
from hlp.rendering.rasterizer import render_depth, render_scene
from hlp.rendering.sensor import Kinect, noisy_depth, noisy_rgb

LINEMOD_CAMERA = np.array([[572.4114, 0, 325.2611], [0, 573.57043, 242.04899], [0, 0, 1.0]])
"""LINEMOD's intrinsics (px) at 640×480; other image sizes scale them."""
_FULL_SIZE = (640, 480)
_BACKGROUND_SEED = 1_000_000  # far from the seeds of scenes with targets
_CACHED = 64  # frames of 2 MB each at full size: rendering takes longer than finding an object


@DATASETS.register
@dataclass(frozen=True)
class SyntheticSettings(layout.SceneSettings):
    """Config group `data`: the synthetic demo, objects modelled in code, scenes rendered on demand.

    Every value is ours (D). Ranges are [least, most].
    """

    name: Literal["synthetic"] = "synthetic"

    def build(self) -> Dataset:
        """The demo's objects and scenes; frames without the objects to train with."""
        return dataset_of(self, SyntheticScenes(self), demo_objects())


@dataclass(frozen=True)
class Scene:
    """A scene before the sensor model: its layout and its clean rendering.

    `index` is the number of the item seen at each pixel, -1 for none; `depth` in metres, 0 = none.
    """

    items: tuple[layout.Item, ...]
    pose_cam_world: Pose
    rgb: Rgb
    depth: Image
    index: Int[np.ndarray, "h w"]

    def pose_cam_obj(self, item: int) -> Pose:
        """Pose (4, 4) of the item with that number."""
        return np.asarray(self.pose_cam_world @ self.items[item].pose_world_obj)


class SyntheticScenes:
    """A `FrameSource` of demo scenes with one frame each.

    A frame depends only on the settings, which include the seed, and its number. With
    `targets=False` clutter takes the place of the demo objects, so that networks can be trained on
    the frames without seeing a target. Raises ValueError naming a setting that makes no scene.
    """

    def __init__(self, settings: layout.SceneSettings, targets: bool = True) -> None:
        self.settings = settings
        self._targets = targets
        self._scale = settings.width / _FULL_SIZE[0], settings.shape[0] / _FULL_SIZE[1]
        self.camera_matrix: Float[np.ndarray, "3 3"] = np.diag([*self._scale, 1.0]) @ LINEMOD_CAMERA
        self._numbers = {frame_key(number, 0): number for number in range(settings.scenes)}
        self._frames = lru_cache(_CACHED)(self._make)
        self._scenes = lru_cache(1)(self._render)

    @property
    def keys(self) -> tuple[str, ...]:
        """`Frame.key` of the frames, in order."""
        return tuple(self._numbers)

    def identity(self) -> str:
        """Hash of the settings, `targets`, and the source of this generator."""
        made_by = source_digest(type(self).__module__)
        return content_hash([], f"synthetic {made_by} {self._targets} {self.settings}")

    def load(self, key: str) -> Frame:
        """One frame. Raises KeyError for an unknown key."""
        return self._frames(key)

    def _make(self, key: str) -> Frame:
        scene, number = self.scene(key), self._numbers[key]
        sensor = Kinect(self.settings.noise, binning=1.0 / self._scale[0])
        rng = self._rng(number, "sensor")
        return Frame(
            scene_id=number,
            frame_id=0,
            rgb=noisy_rgb(scene.rgb, rng, sensor),
            depth=noisy_depth(scene.depth, float(self.camera_matrix[0, 0]), rng, sensor),
            camera_matrix=self.camera_matrix.copy(),
            targets=self._find_targets(scene),
        )

    def scene(self, key: str) -> Scene:
        """The scene of a frame before the sensor model. Raises KeyError for an unknown key."""
        return self._scenes(key)

    def _render(self, key: str) -> Scene:
        if key not in self._numbers:
            count = len(self._numbers)
            raise KeyError(f"no synthetic frame {key!r}: there are {count}, named as in .keys")
        rng = self._rng(self._numbers[key], "layout")
        settings = self.settings
        azimuth = rng.uniform(0.0, 2 * np.pi)
        pose_cam_world = layout.look_at(
            target=np.array([*rng.uniform(-0.04, 0.04, 2), 0.05]),
            distance=rng.uniform(*settings.distance_mm) / 1000.0,
            azimuth=azimuth,
            elevation=np.radians(rng.uniform(*settings.elevation_deg)),
            roll=np.radians(rng.uniform(-settings.roll_deg, settings.roll_deg)),
        )
        items = self._place(inverse(pose_cam_world)[:3, 3], rng)
        light = layout.light_from_above(pose_cam_world, rng)
        parts = [(item.mesh, pose_cam_world @ item.pose_world_obj) for item in items]
        view = (self.camera_matrix, settings.shape, light)
        rgb, depth, index = render_scene(parts, *view)
        around = random_surroundings(azimuth, rng)
        back_rgb, back_depth = draw_surroundings(around, items, pose_cam_world, *view)
        # The surfaces are behind all items: pixels without an item show a surface or nothing.
        empty = index < 0
        rgb[empty], depth[empty] = back_rgb[empty], back_depth[empty]
        return Scene(tuple(items), pose_cam_world, rgb, depth, index)

    def visible_mask(self, frame: Frame, target: Target) -> Mask:
        """Pixels that show one of the frame's targets, with or without sensor depth.

        Raises KeyError for an unknown frame.
        """
        scene = self.scene(frame.key)
        poses = (scene.pose_cam_obj(number).tolist() for number in range(len(scene.items)))
        there = [(i.object_id, pose) for i, pose in zip(scene.items, poses, strict=True)]
        number = there.index((target.object_id, target.pose_cam_obj.tolist()))
        return np.asarray(scene.index == number)

    def _place(self, eye: Vector, rng: np.random.Generator) -> list[layout.Item]:
        """Randomly chosen objects and clutter; only clutter without targets."""
        settings = self.settings
        count = layout.between(settings.objects, rng)
        clutter = layout.between(settings.clutter, rng)
        if not self._targets:
            return layout.place_clutter(count + clutter, [], eye, rng)
        models = list(demo_objects().values())
        chosen = rng.permutation(len(models))[:count]
        shown = [models[i] for i in chosen]
        items = layout.place_targets(shown, np.radians(settings.tilt_deg), rng)
        return items + layout.place_clutter(clutter, items, eye, rng)

    def _find_targets(self, scene: Scene) -> tuple[Target, ...]:
        """The objects that are sufficiently visible, by object id."""
        targets = []
        for number, item in enumerate(scene.items):
            if item.object_id == 0:
                continue
            pose = scene.pose_cam_obj(number)
            alone = silhouette_area(item, pose, self.camera_matrix)
            visible = np.count_nonzero(scene.index == number) / alone
            if visible >= self.settings.min_visible:
                targets.append(Target(item.object_id, pose, float(visible)))
        return tuple(sorted(targets, key=lambda target: target.object_id))

    def _rng(self, number: int, purpose: str) -> np.random.Generator:
        streams = ("layout", "sensor").index(purpose) * 2 + int(self._targets)
        return np.random.default_rng([self.settings.seed, number, streams])


def dataset_of(
    settings: DataSettings, frames: SyntheticScenes, models: dict[int, ObjectModel]
) -> Dataset:
    """The objects in the frames; scenes of clutter alone to train with.

    These have the default settings, whatever those of the test scenes: more noise in a test set, or
    another size, is no reason to train again.
    """
    count = frames.settings.background_frames
    training = SyntheticSettings(scenes=count, seed=_BACKGROUND_SEED)
    background = SyntheticScenes(training, targets=False)
    return Dataset(
        models,
        tuple(models),
        frames,
        background_frames=background,
        encoder_frames=background,
        settings=settings,
    )


def silhouette_area(item: layout.Item, pose_cam_obj: Pose, camera_matrix: CameraMatrix) -> int:
    """Number of pixels that an item would cover without occlusion and image border."""
    pixels = project(transform(pose_cam_obj, item.mesh.vertices), camera_matrix)
    low = np.floor(pixels.min(axis=0)) - 1
    width, height = (np.ceil(pixels.max(axis=0)) + 2 - low).astype(int)
    window = camera_matrix.copy()
    window[:2, 2] -= low
    depth = render_depth(item.mesh, pose_cam_obj[None], window, (int(height), int(width)), 1)
    return int(np.count_nonzero(depth))
