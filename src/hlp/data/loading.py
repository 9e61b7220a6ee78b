"""Builds the configured data set: objects, frames and backgrounds."""

from pathlib import Path

from hlp.data import bop_models, linemod, own_frames
from hlp.data.bop import BopFrames, BopSettings
from hlp.data.dataset import Dataset
from hlp.data.linemod import LinemodFrames, LinemodSettings
from hlp.data.own_frames import FilesSettings, OwnFrames
from hlp.data.photographs import list_photographs
from hlp.data.rgbd_frames import RgbdFrames
from hlp.data.sources import FrameSource
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings, training_frames
from hlp.errors import MissingFileError

DataSettings = SyntheticSettings | BopSettings | LinemodSettings | FilesSettings

_BACKGROUND_FRAMES = 40
_BACKGROUND_SEED = 1_000_000  # far from the seeds of scenes with targets


def build_dataset(data: DataSettings) -> Dataset:
    """Objects and frames of the configured data set; reads meshes, decodes no image."""
    if isinstance(data, SyntheticSettings):
        background = training_frames(_BACKGROUND_FRAMES, _BACKGROUND_SEED)
        models = demo_objects()
        frames = SyntheticScenes(data)
        return Dataset(models, tuple(models), frames, None, background, background, settings=data)
    if not isinstance(data, FilesSettings) and not Path(data.root).is_dir():
        raise MissingFileError(f"data.root is no folder: {data.root} (set data.root=PATH)")
    photographs = _folder("data.photographs", data.photographs)
    if photographs is not None:
        list_photographs(photographs)
    rooms = _rgbd("data.rooms", data.rooms)
    scenes = _rgbd("data.rgbd_frames", data.rgbd_frames)
    if isinstance(data, FilesSettings):
        model = own_frames.load_object_model(data)
        given = OwnFrames(Path(data.rgb), Path(data.depth), data.intrinsics, data.depth_scale)
        objects = {model.object_id: model}
        return Dataset(
            objects,
            tuple(objects),
            given,
            photographs,
            rooms,
            scenes,
            annotated=False,
            settings=data,
        )
    root = Path(data.root)
    if isinstance(data, LinemodSettings):
        models = linemod.load_object_models(root, data.objects, data.proxy_faces, data.mesh_scale)
        ids = {name: each.id for name, each in data.objects.items()}
        own = LinemodFrames(root, ids, data.camera_matrix)
        return Dataset(models, tuple(models), own, photographs, rooms, scenes, settings=data)
    models = bop_models.load_object_models(
        root, data.objects, data.proxy_faces, data.symmetry_steps
    )
    if not (root / data.split).is_dir():
        raise MissingFileError(f"data.split is no folder: {root / data.split} (set data.split)")
    frames_bop = BopFrames(root, data.split, data.targets, models)
    wanted = {object_id for ids in frames_bop.targets.values() for object_id in ids}
    return Dataset(
        models, tuple(sorted(wanted)), frames_bop, photographs, rooms, scenes, settings=data
    )


def _folder(key: str, path: str | None) -> Path | None:
    if path is None:
        return None
    if not Path(path).is_dir():
        raise MissingFileError(f"{key} is no folder: {path} (set {key}, or null for none)")
    return Path(path)


def _rgbd(key: str, path: str | None) -> FrameSource | None:
    folder = _folder(key, path)
    if folder is None:
        return None
    frames = RgbdFrames(folder)
    len(frames)  # lists the images: what is wrong with the folder is said now
    return frames
