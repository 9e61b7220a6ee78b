"""Settings of the contrastive encoder."""

from dataclasses import dataclass

from hlp.models.encoder_input import EncoderInput


@dataclass(frozen=True)
class ContrastiveSettings:
    """`input` channels, feature `dimension`, layer `widths`, `temperature` and training.

    Pairs of one object nearer than `exclude_mm` and `exclude_deg` are no negatives.
    """

    name: str
    input: EncoderInput
    dimension: int
    widths: tuple[int, ...]
    temperature: float
    exclude_mm: float
    exclude_deg: float
    learning_rate: float
    weight_decay: float
    epochs: int
    batch_size: int
