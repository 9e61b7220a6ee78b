"""Images without any target object, which training needs in addition to the CAD models."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import UInt8

from hlp.errors import ConfigError
from hlp.patches.procedural_backgrounds import procedural_backgrounds
from hlp.records import Frame


class Backgrounds(Protocol):
    """Source of backgrounds for training."""

    def photograph_crops(
        self, count: int, size: int, rng: np.random.Generator
    ) -> UInt8[np.ndarray, "n s s 3"]:
        """Random square crops (RGB) of photographs, or procedural ones."""

    def load_background_frames(self) -> Sequence[Frame]:
        """RGB-D frames used as backgrounds of rendered objects; may be empty."""

    def load_encoder_frames(self) -> Sequence[Frame]:
        """RGB-D frames that train the autoencoder (only encoder=cae).

        Raises ValueError if there are none.
        """


@dataclass(frozen=True)
class GivenBackgrounds:
    """Procedural crops, and RGB-D frames given by the caller, of places without the objects."""

    frames: tuple[Frame, ...] = ()

    def photograph_crops(
        self, count: int, size: int, rng: np.random.Generator
    ) -> UInt8[np.ndarray, "n s s 3"]:
        """See `Backgrounds`: procedural ones."""
        return procedural_backgrounds(count, size, rng)

    def load_background_frames(self) -> Sequence[Frame]:
        """See `Backgrounds`."""
        return self.frames

    def load_encoder_frames(self) -> Sequence[Frame]:
        """See `Backgrounds`."""
        if not self.frames:
            raise ConfigError("encoder=cae trains on RGB-D frames without the objects: give some")
        return self.frames
