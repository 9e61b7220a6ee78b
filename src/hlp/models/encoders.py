"""The interface of alternatives for the local encoder: settings, training, loading."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from hlp.models.encoder import Encoder
from hlp.registry import Registry

if TYPE_CHECKING:
    from pytorch_lightning import LightningDataModule
    from torch import Tensor

STEM = "encoder"
"""Name, without its ending, of the ONNX files of a trained network."""


class EncoderModule(Protocol):
    """A LightningModule that trains the encoder's network."""

    network: Any
    """The network; its `layers` are applied one after the other."""

    def images(self, batch: Any) -> Tensor:
        """The network's input (n, c, p, p) for a batch."""
        ...


class EncoderTraining(Protocol):
    """Data and tools for training an encoder. Data are made only when requested."""

    def pair_batches(self, with_color: bool, batch_size: int) -> LightningDataModule:
        """Pairs of rendered patches of one surface point, in two views and conditions."""
        ...

    def pair_patches(self) -> tuple[Float[np.ndarray, "n p p"], Bool[np.ndarray, "n p p"]]:
        """Relative depth and validity of one patch of each pair, as rendered."""
        ...

    def frame_batches(
        self, per_frame: int, batch_size: int, rooms: bool, varied_light: bool
    ) -> LightningDataModule:
        """Patches of RGB-D frames without the objects, `per_frame` of each frame.

        With `rooms` also of the frames that are backgrounds. With `varied_light` a batch also holds
        the patches' colour under another light. Raises ValueError if there are no such frames.
        """
        ...

    def fit(self, module: EncoderModule, data: LightningDataModule, epochs: int) -> None:
        """Train a module; its network is written into `folder` as weights and ONNX (`STEM`)."""
        ...

    @property
    def folder(self) -> Path:
        """The folder for everything that the encoder learns."""
        ...


class EncoderSettings(Protocol):
    """Settings of an encoder of local patches."""

    needs_frames: ClassVar[bool]
    """Whether it trains on RGB-D frames without the objects instead of on rendered views."""

    @property
    def name(self) -> str:
        """The alternative's name."""
        ...

    @property
    def dimension(self) -> int:
        """Length of the feature."""
        ...

    def train(self, training: EncoderTraining) -> None:
        """Train into `training.folder`. The caller has set torch's seed."""
        ...

    def load(self, folder: Path, threads: int, device: str) -> Encoder:
        """The encoder that `train` wrote into a folder. A network runs on the device."""
        ...


@runtime_checkable
class FeatureDecoder(Protocol):
    """Settings of an encoder that can also turn features back into patches, for pictures."""

    @property
    def input(self) -> str:
        """The channels of its patches, by the name that `patch_input` takes."""
        ...

    def decode(
        self, folder: Path, features: Float[np.ndarray, "n d"]
    ) -> Float[np.ndarray, "n p p 4"] | None:
        """Patches in [-1, 1] from features, by what `train` wrote; None if it wrote no decoder."""
        ...


ENCODERS: Registry[EncoderSettings] = Registry("encoder", "hlp.models")
"""Alternatives of config group `encoder`."""
