"""Settings of the contrastive encoder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt, Le

from hlp.models.encoder import Encoder, NetworkEncoder
from hlp.models.encoders import ENCODERS, STEM, EncoderTraining
from hlp.models.network import load_network
from hlp.settings import Doc, Settings


@ENCODERS.register
@dataclass(frozen=True)
class ContrastiveSettings(Settings):
    """Config group `encoder`: a network trained contrastively on pairs of rendered patches (D)."""

    name: Literal["contrastive"] = "contrastive"
    input: Annotated[Literal["rgbd", "normals_depth"], Doc("channels of the input (D)")] = (
        "normals_depth"
    )
    dimension: Annotated[
        int, Ge(1), Le(4096), Doc("length of the feature (P: 100, 200, 400, 600 in Fig. 9a)")
    ] = 200
    widths: Annotated[
        tuple[Annotated[int, Ge(1)], ...],
        Doc("channels of the strided convolutions (D: the text does not give Fig. 6's sizes)"),
    ] = (32, 64, 96, 128)
    temperature: Annotated[float, Gt(0), Le(100), Doc("temperature of InfoNCE (D)")] = 0.07
    exclude_mm: Annotated[
        float, Ge(0), Doc("pairs of one object at most this far apart are no negatives … (D)")
    ] = 15.0
    exclude_deg: Annotated[float, Ge(0), Doc("… if their views differ by at most this (D)")] = 20.0
    learning_rate: Annotated[
        float, Ge(0), Le(1), Doc("highest rate of the one-cycle schedule (D)")
    ] = 2.0e-3
    weight_decay: Annotated[float, Ge(0), Le(1), Doc("of AdamW (D)")] = 1.0e-3
    epochs: Annotated[int, Ge(1), Le(10_000), Doc("passes over the pairs (D)")] = 4
    batch_size: Annotated[int, Ge(1), Doc("pairs in a batch (D)")] = 512

    needs_frames: ClassVar[bool] = False

    def train(self, training: EncoderTraining) -> None:
        """See `EncoderSettings.train`."""
        from hlp.models.contrastive_training import ContrastiveEncoder

        data = training.pair_batches(self.input == "rgbd", self.batch_size)
        module = ContrastiveEncoder(self)
        training.fit(module, data, self.epochs)

    def load(self, folder: Path, threads: int, device: str) -> Encoder:
        """See `EncoderSettings.load`."""
        network = load_network(folder / STEM, threads, device)
        return NetworkEncoder(network, self.input, True)
