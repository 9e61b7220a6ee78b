"""Folders of RGB-D frames that say by their names what is in them: `rgb/`, `depth/`, a camera."""

from collections.abc import Mapping
from pathlib import Path

from hlp.errors import InputError, MissingFileError

CAMERA_FILES = ("cam_K.txt", "camera.json", "intrinsics.json", "scene_camera.json")
"""Names of the file with the intrinsics: YCBInEOAT's, ours, RealSense's or Open3D's, BOP's."""
_NAMES = {"rgb": ("rgb", "color"), "depth": ("depth",), "intrinsics": CAMERA_FILES}


def with_frames(given: Mapping[str, str]) -> dict[str, str]:
    """Arguments in which `frames=FOLDER` is replaced by what is in the folder.

    What is given besides, such as the intrinsics, is taken in place of the folder's. Raises
    MissingFileError for what is not there, and InputError if `rgb` is given too.
    """
    if "frames" not in given:
        return dict(given)
    if "rgb" in given:
        raise InputError("frames and rgb: give one of them")
    root = Path(given["frames"]).expanduser()
    if not root.is_dir():
        raise MissingFileError(f"frames is no folder: {root} (set frames=FOLDER)")
    rest = {key: value for key, value in given.items() if key != "frames"}
    found = {key: _first(root, names, key) for key, names in _NAMES.items() if key not in rest}
    return found | rest


def _first(root: Path, names: tuple[str, ...], key: str) -> str:
    for name in names:
        if (root / name).exists():
            return str(root / name)
    raise MissingFileError(f"{root} has no {' or '.join(names)}: give {key}=… too")
