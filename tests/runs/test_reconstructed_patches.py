from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from hlp.models.encoder import patch_input
from hlp.records import LocalPatches
from hlp.runs.patch_entries import reconstruct


class MeanColor:
    """An encoder whose features are the mean colour, and a decoder that paints it."""

    input = "rgbd"
    sees_color = True

    def __init__(self, kept: bool) -> None:
        self.kept = kept

    def encode(self, patches: LocalPatches) -> np.ndarray:
        return np.asarray(patches.color.mean(axis=(1, 2)) / 127.5 - 1.0)

    def decode(self, _: Path, features: np.ndarray) -> np.ndarray | None:
        painted = np.zeros((len(features), 4, 4, 4))
        painted[..., :3] = features[:, None, None]
        return painted if self.kept else None


def training(encoder: Any) -> Any:
    return SimpleNamespace(
        settings=SimpleNamespace(encoder=encoder),
        load_encoder=lambda: encoder,
        encoder=lambda: SimpleNamespace(folder=Path("encoder")),
    )


def patches(count: int) -> LocalPatches:
    rng = np.random.default_rng(0)
    return LocalPatches(
        rng.integers(0, 256, (count, 4, 4, 3)).astype(np.uint8),
        rng.uniform(-1, 1, (count, 4, 4)).astype(np.float32),
        np.ones((count, 4, 4), bool),
        np.zeros((count, 3)),
        np.zeros((count, 2)),
    )


def test_patches_stand_beside_what_is_rebuilt_of_their_features() -> None:
    found = reconstruct(training(MeanColor(kept=True)), "cat", patches(3))
    assert found is not None and found.name == "cat"
    np.testing.assert_array_equal(found.patches, patch_input(patches(3), "rgbd"))
    mean = found.patches[..., :3].mean(axis=(1, 2))
    np.testing.assert_allclose(found.rebuilt[:, 0, 0, :3], mean, atol=1e-6)


def test_nothing_is_shown_without_a_decoder_or_patches() -> None:
    assert reconstruct(training(MeanColor(kept=False)), "cat", patches(3)) is None
    assert reconstruct(training(SimpleNamespace(sees_color=False)), "cat", patches(3)) is None
    assert reconstruct(training(MeanColor(kept=True)), "cat", patches(0)) is None
