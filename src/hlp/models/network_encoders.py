"""Settings of the encoders that are networks: the paper's autoencoder, and the contrastive one."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from annotated_types import Le

from hlp.models.encoder import (
    ENCODERS,
    STEM,
    Encoder,
    EncoderInput,
    EncoderTraining,
    NetworkEncoder,
)
from hlp.models.network import load_network
from hlp.settings import Count, Doc, NotNegative, Positive, Settings


@dataclass(frozen=True)
class NetworkSettings(Settings):
    """What the encoders that are networks have in common (paper, Fig. 6)."""

    name: str = ""
    input: Annotated[EncoderInput, Doc("channels of the input (D; P: rgbd)")] = "normals_depth"
    dimension: Annotated[
        Count, Le(4096), Doc("length of the feature (P: 100, 200, 400, 600 in Fig. 9a)")
    ] = 200
    widths: Annotated[
        tuple[Count, ...],
        Doc("channels of the strided convolutions (D: the text does not give Fig. 6's sizes)"),
    ] = (32, 64, 96, 128)

    unit_length: ClassVar[bool] = False

    def load(self, folder: Path, threads: int, device: str) -> Encoder:
        """See `EncoderSettings.load`."""
        network = load_network(folder / STEM, threads, device)
        return NetworkEncoder(network, self.input, self.unit_length)


@ENCODERS.register
@dataclass(frozen=True)
class AutoencoderSettings(NetworkSettings):
    """Config group `encoder`: the paper's autoencoder, trained on RGB-D scenes (Fig. 6)."""

    name: Literal["cae"] = "cae"
    input: Annotated[EncoderInput, Doc("channels of the input (P: rgbd)")] = "rgbd"
    learning_rate: Annotated[NotNegative, Le(1), Doc("the highest rate (D)")] = 1.0e-3
    weight_decay: Annotated[NotNegative, Le(1), Doc("of AdamW (D)")] = 0.0
    epochs: Annotated[Count, Le(10_000), Doc("passes over the patches (D)")] = 20
    batch_size: Annotated[Count, Doc("patches in a batch (D)")] = 256
    per_frame: Annotated[Count, Doc("patches taken from each RGB-D frame (D)")] = 4000
    rooms: Annotated[
        bool, Doc("trained on the frames of rooms (data.rooms), too (D; P: not said)")
    ] = False
    varied_light: Annotated[
        bool,
        Doc(
            "a patch is reconstructed from a copy of it under random light, so that light matters "
            "less in the feature (D; P: not said)"
        ),
    ] = False
    one_cycle: Annotated[
        bool,
        Doc(
            "the rate rises during the first tenth of the training and falls to nothing (D); "
            "otherwise it is constant"
        ),
    ] = False

    needs_frames: ClassVar[bool] = True

    def train(self, training: EncoderTraining) -> None:
        """See `EncoderSettings.train`."""
        from hlp.models.network_training import Autoencoder

        data = training.frame_batches(
            self.per_frame, self.batch_size, self.rooms, self.varied_light
        )
        training.fit(Autoencoder(self), data, self.epochs)


@ENCODERS.register
@dataclass(frozen=True)
class ContrastiveSettings(NetworkSettings):
    """Config group `encoder`: a network trained contrastively on pairs of rendered patches (D)."""

    name: Literal["contrastive"] = "contrastive"
    temperature: Annotated[Positive, Le(100), Doc("temperature of InfoNCE (D)")] = 0.07
    exclude_mm: Annotated[
        NotNegative, Doc("pairs of one object at most this far apart are no negatives … (D)")
    ] = 15.0
    exclude_deg: Annotated[NotNegative, Doc("… if their views differ by at most this (D)")] = 20.0
    learning_rate: Annotated[
        NotNegative, Le(1), Doc("highest rate of the one-cycle schedule (D)")
    ] = 2.0e-3
    weight_decay: Annotated[NotNegative, Le(1), Doc("of AdamW (D)")] = 1.0e-3
    epochs: Annotated[Count, Le(10_000), Doc("passes over the pairs (D)")] = 4
    batch_size: Annotated[Count, Doc("pairs in a batch (D)")] = 512

    needs_frames: ClassVar[bool] = False
    unit_length: ClassVar[bool] = True

    def train(self, training: EncoderTraining) -> None:
        """See `EncoderSettings.train`."""
        from hlp.models.network_training import ContrastiveEncoder

        data = training.pair_batches(self.input == "rgbd", self.batch_size)
        training.fit(ContrastiveEncoder(self), data, self.epochs)
