"""Photographs as backgrounds: any folder of images, such as PASCAL VOC's `JPEGImages`."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from hlp.data.images import EXTENSIONS, read_rgb
from hlp.errors import MissingFileError

Image = UInt8[np.ndarray, "h w 3"]
_MOST = 400
_LONG_SIDE = 400


def list_photographs(folder: Path) -> tuple[Path, ...]:
    """All images below a folder, sorted; of a VOC data set only `JPEGImages`, not the masks.

    Raises FileNotFoundError if there is no such folder or no image in it.
    """
    if not folder.is_dir():
        raise MissingFileError(f"no folder of photographs {folder}: check data.photographs")
    found = sorted(path for path in folder.rglob("*") if path.suffix.lower() in EXTENSIONS)
    voc = [path for path in found if path.parent.name == "JPEGImages"]
    if not found:
        raise MissingFileError(f"no photograph (jpg, png) in {folder}: check data.photographs")
    return tuple(voc or found)


def load_photographs(paths: Sequence[Path], limit: int, long_side: int) -> list[Image]:
    """Decode at most `limit` photographs, spread over `paths`, shrunk to `long_side` pixels.

    Raises DataError naming a file that is broken.
    """
    count = min(limit, len(paths))
    chosen = np.linspace(0, len(paths) - 1, count).round().astype(int)
    return [_shrink(read_rgb(paths[i]), long_side) for i in chosen]


def random_crops(
    images: Sequence[Image], count: int, size: int, rng: np.random.Generator
) -> UInt8[np.ndarray, "n s s 3"]:
    """Random square crops of random images, mirrored half of the time, resized to `size` pixels.

    The crop's side is uniform between `size` / 2 and the image's short side.
    """
    crops = np.empty((count, size, size, 3), np.uint8)
    for crop in crops:
        image = images[int(rng.integers(len(images)))]
        short = min(image.shape[:2])
        side = int(rng.integers(min(max(size // 2, 1), short), short + 1))
        top = int(rng.integers(image.shape[0] - side + 1))
        left = int(rng.integers(image.shape[1] - side + 1))
        patch = image[top : top + side, left : left + side]
        if rng.random() < 0.5:
            patch = patch[:, ::-1]
        # Bilinear resizing aliases when it shrinks; area resizing is blocky when it enlarges.
        method = cv2.INTER_AREA if side > size else cv2.INTER_LINEAR
        crop[:] = cv2.resize(np.ascontiguousarray(patch), (size, size), interpolation=method)
    return crops


def _shrink(image: Image, long_side: int) -> Image:
    height, width = image.shape[:2]
    factor = long_side / max(height, width)
    if factor >= 1:
        return image
    shape = (max(1, round(width * factor)), max(1, round(height * factor)))
    return np.asarray(cv2.resize(image, shape, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def photograph_crops(
    folder: Path, count: int, size: int, rng: np.random.Generator
) -> UInt8[np.ndarray, "n s s 3"]:
    """Random square crops of the photographs in a folder."""
    images = load_photographs(list_photographs(folder), _MOST, _LONG_SIDE)
    return random_crops(images, count, size, rng)
