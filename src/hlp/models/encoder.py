"""Local encoders during detection (paper, section 3.2)."""

from typing import Protocol

import numpy as np
from jaxtyping import Float

from hlp.models.encoder_input import empty_features, patch_input, sees_color
from hlp.models.network import Network
from hlp.records import LocalPatches

RESOLUTION = 32  # px of a patch's side (paper, section 3.2)
_CHUNK = 512


class Encoder(Protocol):
    """Turns local patches into features; similar patches have a small Euclidean distance.

    `sees_color` says whether it needs patches with colour.
    """

    sees_color: bool

    def encode(self, patches: LocalPatches) -> Float[np.ndarray, "n d"]:
        """Features (n, d) float32 of n patches."""


class NetworkEncoder:
    """A network as encoder, with the same precision for views and scenes.

    `kind` names its input. With `unit_length`, features are divided by their norm, as contrastive
    training assumes.
    """

    def __init__(self, network: Network, kind: str, unit_length: bool) -> None:
        self.network = network
        self.kind = kind
        self.sees_color = sees_color(kind)
        self.unit_length = unit_length

    def encode(self, patches: LocalPatches) -> Float[np.ndarray, "n d"]:
        """Features (n, d) float32 of n patches."""
        features = empty_features(self.network.outputs)
        if len(patches) == 0:
            return features
        images = patch_input(patches, self.kind)
        starts = range(0, len(images), _CHUNK)
        features = np.concatenate([self.network.run(images[i : i + _CHUNK]) for i in starts])
        if self.unit_length:
            norms = np.linalg.norm(features, axis=1, keepdims=True)
            features /= np.maximum(norms, np.float32(1e-12))
        return features
