"""The holistic classifier during detection (paper, section 3.1, Fig. 3)."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Interval, Le
from jaxtyping import Float, UInt8

from hlp.models.network import Network
from hlp.settings import Count, CountOrNone, Doc, NotNegative, Settings, WholeNumber

RESOLUTION = 64  # px of a window's side (paper, Fig. 3)
CHUNK = 256
"""Windows to classify at once: few enough for its activations to stay in the processor's cache."""


@dataclass(frozen=True)
class ClassifierSettings(Settings):
    """Config group `classifier`: the CNN on holistic patches (paper, Fig. 3) and its training.

    The paper's text does not give the layer sizes. Trained by AdamW with a one-cycle schedule.
    """

    name: Literal["cnn"] = "cnn"
    widths: Annotated[tuple[Count, ...], Doc("channels of the strided convolutions (D)")] = (
        16,
        32,
        64,
        128,
    )
    hidden: Annotated[Count, Le(65_536), Doc("units of the dense layer (D)")] = 128
    dropout: Annotated[
        float, Interval(ge=0, lt=1), Doc("dropout rate before each dense layer (D)")
    ] = 0.2
    learning_rate: Annotated[NotNegative, Le(1), Doc("highest rate of the schedule (D)")] = 2.0e-3
    weight_decay: Annotated[NotNegative, Le(1), Doc("of AdamW (D)")] = 1.0e-3
    epochs: Annotated[Count, Le(10_000), Doc("passes over the pool of windows (D)")] = 12
    batch_size: Annotated[Count, Doc("windows in a batch (D)")] = 256
    min_batches: Annotated[
        WholeNumber, Doc("least number of batches: with few objects, epochs are added (D)")
    ] = 150
    prior_objects: Annotated[
        CountOrNone,
        Doc(
            "background is taken to be as likely as if at least this many objects were learnt; "
            "null: as in training (D)"
        ),
    ] = 15

    def epochs_for(self, windows: int) -> int:
        """Passes over a pool of so many windows."""
        batches = max(1, windows // self.batch_size)
        return max(self.epochs, -(-self.min_batches // batches))


def class_probabilities(
    network: Network, images: UInt8[np.ndarray, "n p p c"]
) -> Float[np.ndarray, "n classes"]:
    """Softmax over the classes for windows as `WindowImages` cuts them."""
    scores = network.run(images)
    shares = np.exp(scores - scores.max(axis=1, keepdims=True))
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))
