"""CNN that classifies holistic patches (paper, Fig. 3, which does not give the layer sizes)."""

import math
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from hlp.models.classifier import RESOLUTION, ClassifierSettings
from hlp.models.one_cycle import OneCycleModule


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

    @property
    def layers(self) -> list[nn.Module]:
        """The layers in their order."""
        return [*self.features, *self.head]


class HolisticClassifier(OneCycleModule[ClassifierSettings]):
    """Trains `HolisticCNN` by cross-entropy. Class 0 is background."""

    def __init__(self, settings: ClassifierSettings, channels: int, classes: int) -> None:
        super().__init__(settings, rise=0.2)
        self.network = HolisticCNN(
            channels, classes, settings.widths, settings.hidden, settings.dropout
        )

    def images(self, batch: tuple[Tensor, Tensor]) -> Tensor:
        """The network's input (n, c, 64, 64) for a batch."""
        return batch[0]

    def training_step(self, batch: tuple[Tensor, Tensor], _: int) -> Tensor:
        """Cross-entropy of one batch; logs loss and accuracy per epoch."""
        images, labels = batch
        scores = self.network(images)
        loss = functional.cross_entropy(scores.float(), labels, label_smoothing=0.02)
        accuracy = (scores.argmax(dim=1) == labels).float().mean()
        self.log_means({"loss": loss, "accuracy": accuracy})
        return loss


def raise_background(network: HolisticCNN, odds: float) -> None:
    """Multiply the odds of background against every object by a factor, at every window.

    It corrects for objects that are more frequent in training than among the windows of an image.
    """
    last = network.layers[-1]
    assert isinstance(last, nn.Linear)
    with torch.no_grad():
        last.bias[0] += math.log(odds)


def copy_weights(
    network: HolisticCNN, weights: Mapping[str, Tensor], labels: Mapping[int, int]
) -> None:
    """Copy the weights of a network with fewer classes into a new one.

    `labels` maps each class of the other network to a class of this one. The weights of further
    classes stay as they are.
    """
    own, last = network.state_dict(), f"head.{len(network.head) - 1}."
    before, now = list(labels), list(labels.values())
    for name, value in weights.items():
        if name.startswith(last):
            own[name][now] = value[before]
        else:
            own[name].copy_(value)
