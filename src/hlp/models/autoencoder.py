"""Settings of the convolutional autoencoder (paper, section 3.2, Fig. 6)."""

from dataclasses import dataclass

from hlp.models.encoder_input import EncoderInput


@dataclass(frozen=True)
class AutoencoderSettings:
    """`input` channels, feature `dimension` (Fig. 9a), layer `widths` and training.

    `per_frame` patches are taken from each RGB-D frame of the training folder.
    """

    name: str
    input: EncoderInput
    dimension: int
    widths: tuple[int, ...]
    learning_rate: float
    weight_decay: float
    epochs: int
    batch_size: int
    per_frame: int
