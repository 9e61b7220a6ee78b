"""What an encoder of local patches must offer to be an alternative: settings, training, loading."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

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
    """What is handed to Lightning to be trained: a LightningModule with the encoder's network."""

    network: Any
    """The network; its `layers` are applied one after the other."""

    def images(self, batch: Any) -> Tensor:
        """The network's input (n, c, p, p) for a batch."""
        ...


class EncoderTraining(Protocol):
    """What an encoder is trained with; every part is made when it is asked for."""

    def pair_batches(self, with_color: bool, batch_size: int) -> LightningDataModule:
        """Pairs of rendered patches that show one surface point, in two views and conditions."""
        ...

    def pair_patches(self) -> tuple[Float[np.ndarray, "n p p"], Bool[np.ndarray, "n p p"]]:
        """Relative depth and validity of one patch of each pair, as rendered."""
        ...

    def frame_batches(self, per_frame: int, batch_size: int) -> LightningDataModule:
        """Patches of RGB-D frames without the objects, so many of each frame.

        Raises ValueError where there are no such frames.
        """
        ...

    def fit(self, module: EncoderModule, data: LightningDataModule, epochs: int) -> None:
        """Train a module; its network is left in `folder`, weights and ONNX (`STEM`)."""
        ...

    @property
    def folder(self) -> Path:
        """Where whatever the encoder has learnt is to be left."""
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
        """Train into `training.folder`. What is random follows from torch's seed, set before."""
        ...

    def load(self, folder: Path, threads: int, device: str) -> Encoder:
        """The encoder that `train` left in a folder; a network runs on the device."""
        ...


ENCODERS: Registry[EncoderSettings] = Registry("encoder", "hlp.models")
"""Alternatives of config group `encoder`."""
