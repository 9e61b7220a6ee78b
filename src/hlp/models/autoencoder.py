"""Settings of the convolutional autoencoder (paper, section 3.2, Fig. 6)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Le
from jaxtyping import Float

from hlp.models.encoder import Encoder, NetworkEncoder
from hlp.models.encoders import ENCODERS, STEM, EncoderTraining
from hlp.models.network import load_network
from hlp.settings import Doc, Settings


@ENCODERS.register
@dataclass(frozen=True)
class AutoencoderSettings(Settings):
    """Config group `encoder`: the paper's autoencoder, trained on RGB-D scenes (Fig. 6)."""

    name: Literal["cae"] = "cae"
    input: Annotated[Literal["rgbd", "normals_depth"], Doc("channels of the input (P: rgbd)")] = (
        "rgbd"
    )
    dimension: Annotated[
        int, Ge(1), Le(4096), Doc("length of the feature (P: 100, 200, 400, 600 in Fig. 9a)")
    ] = 200
    widths: Annotated[
        tuple[Annotated[int, Ge(1)], ...],
        Doc("channels of the strided convolutions (D: the text does not give Fig. 6's sizes)"),
    ] = (32, 64, 96, 128)
    learning_rate: Annotated[float, Ge(0), Le(1), Doc("the highest rate (D)")] = 1.0e-3
    weight_decay: Annotated[float, Ge(0), Le(1), Doc("of AdamW (D)")] = 0.0
    epochs: Annotated[int, Ge(1), Le(10_000), Doc("passes over the patches (D)")] = 20
    batch_size: Annotated[int, Ge(1), Doc("patches in a batch (D)")] = 256
    per_frame: Annotated[int, Ge(1), Doc("patches taken from each RGB-D frame (D)")] = 4000
    rooms: Annotated[
        bool, Doc("trained on the frames of rooms (data.rooms), too (D; P: not said)")
    ] = False
    varied_light: Annotated[
        bool,
        Doc(
            "patches under random light are to become the patches as they were, so that light "
            "matters less in the feature (D; P: not said)"
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
        from hlp.models.contrastive_training import Autoencoder
        from hlp.models.patch_encoder import save_decoder

        data = training.frame_batches(
            self.per_frame, self.batch_size, self.rooms, self.varied_light
        )
        module = Autoencoder(self)
        training.fit(module, data, self.epochs)
        save_decoder(module.decoder, training.folder)

    def load(self, folder: Path, threads: int, device: str) -> Encoder:
        """See `EncoderSettings.load`."""
        network = load_network(folder / STEM, threads, device)
        return NetworkEncoder(network, self.input, False)

    def decode(
        self, folder: Path, features: Float[np.ndarray, "n d"]
    ) -> Float[np.ndarray, "n p p 4"] | None:
        """See `FeatureDecoder.decode`."""
        from hlp.models.patch_encoder import decode

        return decode(folder, self.widths, features)
