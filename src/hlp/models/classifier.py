"""The holistic classifier during detection (paper, section 3.1, Fig. 3)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from hlp.models.network import Network

RESOLUTION = 64  # px of a window's side (paper, Fig. 3)
CHUNK = 256
"""Windows at once: what a chunk's layers put out stays in the processor's cache."""


@dataclass(frozen=True)
class ClassifierSettings:
    """Layer sizes and training of the classifier.

    `widths` of the strided convolutions, `hidden` of the dense layer; AdamW with a one-cycle
    schedule up to `learning_rate` over `epochs` of the pool.
    """

    name: str
    widths: tuple[int, ...]
    hidden: int
    dropout: float
    learning_rate: float
    weight_decay: float
    epochs: int
    batch_size: int


def class_probabilities(
    network: Network, images: UInt8[np.ndarray, "n p p c"]
) -> Float[np.ndarray, "n classes"]:
    """Softmax over the classes for windows as `WindowImages` cuts them, in chunks."""
    chunks = [np.zeros((0, network.outputs), dtype=np.float32)]
    for start in range(0, len(images), CHUNK):
        scores = network.run(images[start : start + CHUNK])
        shares = np.exp(scores - scores.max(axis=1, keepdims=True))
        chunks.append(shares / shares.sum(axis=1, keepdims=True))
    return np.concatenate(chunks)
