"""Where objects are looked for: masks of the frames, or one box for all of them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from hlp.data.frame_paths import FramePaths, list_images
from hlp.data.images import EXTENSIONS, decode_unchanged
from hlp.errors import DataError, InputError, MissingFileError


@dataclass(frozen=True)
class SearchMasks:
    """Mask images (an image for all frames, or a folder with their names), or a box.

    `box` is x, y, width and height in pixels. One of both is given.
    """

    masks: str | None = None
    box: tuple[float, float, float, float] | None = None

    def load(self, paths: FramePaths, shape: tuple[int, ...]) -> Bool[np.ndarray, "h w"]:
        """Where to look in a frame. Raises MissingFileError, DataError, InputError."""
        mask = np.zeros(shape, dtype=bool)
        if self.box is not None:
            x, y, width, height = (round(value) for value in self.box)
            mask[max(y, 0) : max(y + height, 0), max(x, 0) : max(x + width, 0)] = True
            if not mask.any():
                raise InputError(
                    f"box={list(self.box)} lies outside {paths.color}: x,y,width,height"
                )
            return mask
        path = self._path(paths)
        image = decode_unchanged(path)
        if image.shape[:2] != shape:
            raise DataError(f"{path} is {image.shape[:2]}, the frame {shape}: they must be alike")
        mask = np.asarray(image.reshape(*shape, -1)[..., :3].any(axis=2))
        if not mask.any():
            raise DataError(f"{path} marks no pixel: leave the frame out, or mark where to look")
        return mask

    def _path(self, paths: FramePaths) -> Path:
        found = list_images(str(self.masks), "mask", EXTENSIONS)
        if Path(str(self.masks)).is_file():
            return found[0]
        named = next((each for each in found if each.stem == paths.name), None)
        if named is None:
            raise MissingFileError(f"mask: {self.masks} has no {paths.name}.png for {paths.color}")
        return named
