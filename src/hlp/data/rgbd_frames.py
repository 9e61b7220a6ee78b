"""A plain folder of RGB-D frames: `rgb/`, `depth/` (same names) and `camera.json`."""

from functools import cached_property
from pathlib import Path

from hlp.data.dataset import content_hash
from hlp.data.images import (
    EXTENSIONS,
    camera_matrix,
    find_image,
    read_depth,
    read_rgb,
    same_size,
)
from hlp.errors import MissingFileError
from hlp.records import Frame, frame_key, parse_frame_key
from hlp.schemas.bop import CameraEntry
from hlp.schemas.reading import read_as


class RgbdFrames:
    """Frames without targets (a `FrameSource`) for training.

    `camera.json` holds `cam_K` (9 numbers, row-major, pixels) and `depth_scale` (mm per unit of the
    16-bit depth PNGs, by default 1). Constructing it reads no file. Frames are numbered in the
    order of their names and belong to the scene `scene_id`.
    """

    def __init__(self, root: Path, scene_id: int = 0) -> None:
        self._root, self._scene_id = Path(root), scene_id

    @cached_property
    def _paths(self) -> dict[str, tuple[Path, Path]]:
        color, depth = self._root / "rgb", self._root / "depth"
        if not color.is_dir() or not depth.is_dir():
            raise MissingFileError(f"{self._root} has no folders rgb and depth: check the path")
        images = sorted(p for p in color.iterdir() if p.suffix.lower() in EXTENSIONS)
        if not images:
            raise MissingFileError(f"no image in {color}")
        return {
            frame_key(self._scene_id, number): (path, find_image(depth, path.stem))
            for number, path in enumerate(images)
        }

    @property
    def keys(self) -> tuple[str, ...]:
        """Frame keys, numbered in the order of the file names."""
        return tuple(self._paths)

    def __len__(self) -> int:
        return len(self._paths)

    def load(self, key: str) -> Frame:
        """Decode one frame. Raises KeyError, FileNotFoundError, or ValueError for a broken file."""
        if key not in self._paths:
            raise KeyError(f"no frame {key!r} in {self._root}")
        color, depth_path = self._paths[key]
        camera_file = self._root / "camera.json"
        camera = read_as(camera_file, CameraEntry)
        matrix = camera_matrix(camera.cam_K, camera_file)
        rgb = read_rgb(color)
        depth = read_depth(depth_path, camera.depth_scale)
        same_size(color, rgb, depth)
        return Frame(*parse_frame_key(key), rgb, depth, matrix)

    def identity(self) -> str:
        """Hash of images and intrinsics."""
        pairs = [path for pair in self._paths.values() for path in pair]
        return content_hash([self._root / "camera.json", *pairs])
