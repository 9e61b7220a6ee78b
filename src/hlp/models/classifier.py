"""CNN that classifies holistic patches (paper, Fig. 3; its sizes are not printed there)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pytorch_lightning as pl
import torch
from jaxtyping import Float
from pytorch_lightning.utilities.types import OptimizerLRScheduler
from torch import Tensor, nn
from torch.nn import functional

from hlp.models.fusing import fuse_for_inference, on_device_of

RESOLUTION = 64  # px of a window's side (paper, Fig. 3)
CHUNK = 256
"""Windows at once: more fall out of the cache and take half as long again."""


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


class HolisticCNN(nn.Module):
    """Strided convolutions, then two dense layers: (n, c, 64, 64) in [-1, 1] → (n, classes)."""

    def __init__(
        self, channels: int, classes: int, widths: Sequence[int], hidden: int, dropout: float
    ) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        previous = channels
        for depth, width in enumerate(widths):
            kernel = 5 if depth == 0 else 3
            layers += [
                nn.Conv2d(previous, width, kernel, stride=2, padding=kernel // 2, bias=False),
                nn.BatchNorm2d(width),
                nn.ReLU(inplace=True),
            ]
            previous = width
        self.features = nn.Sequential(*layers)
        side = RESOLUTION // 2 ** len(widths)
        self.head = nn.Sequential(
            nn.Flatten(),
            nn.Dropout(dropout),
            nn.Linear(previous * side * side, hidden),
            nn.ReLU(inplace=True),
            nn.Dropout(dropout),
            nn.Linear(hidden, classes),
        )

    def forward(self, images: Tensor) -> Tensor:
        """Class scores (n, classes) before the softmax."""
        return torch.as_tensor(self.head(self.features(images)))


class HolisticClassifier(pl.LightningModule):
    """Trains `HolisticCNN` by cross-entropy. Class 0 is background."""

    def __init__(self, settings: ClassifierSettings, channels: int, classes: int) -> None:
        super().__init__()
        self.settings = settings
        self.network = HolisticCNN(
            channels, classes, settings.widths, settings.hidden, settings.dropout
        )

    def training_step(self, batch: tuple[Tensor, Tensor], _: int) -> Tensor:
        """Cross-entropy of one batch; logs loss and accuracy per epoch."""
        images, labels = batch
        scores = self.network(images)
        loss = functional.cross_entropy(scores.float(), labels, label_smoothing=0.02)
        accuracy = (scores.argmax(dim=1) == labels).float().mean()
        self.log("loss", loss, on_step=False, on_epoch=True, prog_bar=True)
        self.log("accuracy", accuracy, on_step=False, on_epoch=True, prog_bar=True)
        return loss

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """AdamW with one cycle over the whole training."""
        optimizer = torch.optim.AdamW(
            self.parameters(),
            lr=self.settings.learning_rate,
            weight_decay=self.settings.weight_decay,
        )
        steps = int(self.trainer.estimated_stepping_batches)
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimizer, self.settings.learning_rate, total_steps=steps, pct_start=0.2
        )
        return {
            "optimizer": optimizer,
            "lr_scheduler": {"scheduler": schedule, "interval": "step"},
        }


def copy_weights(
    network: HolisticCNN, weights: Mapping[str, Tensor], labels: Mapping[int, int]
) -> None:
    """Start a network with the weights of one of fewer classes.

    `labels` gives each class of the other network its class in this one; the rest stay as they are.
    """
    own, last = network.state_dict(), f"head.{len(network.head) - 1}."
    before, now = list(labels), list(labels.values())
    for name, value in weights.items():
        if name.startswith(last):
            own[name][now] = value[before]
        else:
            own[name].copy_(value)


def inference_network(network: HolisticCNN, device: str = "cpu") -> nn.Module:
    """The trained network for finding, see `fuse_for_inference`; the network itself stays as it was."""
    return fuse_for_inference([*network.features, *network.head], device)


@torch.inference_mode()
def class_probabilities(network: nn.Module, images: Tensor) -> Float[np.ndarray, "n classes"]:
    """Softmax over the classes for windows (n, c, 64, 64) in [-1, 1], in chunks.

    `network` is an `inference_network`. What it says of a window does not depend on the others.
    """
    chunks = []
    for part in torch.split(images, CHUNK):
        scores = network(on_device_of(network, part))
        chunks.append(functional.softmax(scores.float().cpu(), dim=1))
    return torch.cat(chunks).numpy()
