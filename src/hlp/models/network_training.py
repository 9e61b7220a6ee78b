"""Networks in training: the holistic classifier, the contrastive encoder and the autoencoder.

The paper (Fig. 3, Fig. 6) does not give the layer sizes. The two patches of a pair show the same
surface point in neighbouring views, one clean and one degraded. InfoNCE (van den Oord et al., 2018)
replaces the paper's reconstruction objective: reconstruction keeps light and clutter in the
feature, InfoNCE removes them.
"""

import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import pytorch_lightning as pl
import torch
from pytorch_lightning.utilities.types import OptimizerLRScheduler
from torch import Tensor, nn
from torch.nn import functional
from torch.optim import AdamW, Optimizer
from torch.optim.lr_scheduler import OneCycleLR

from hlp.models import classifier, encoder
from hlp.models.encoder import normals_with_depth

if TYPE_CHECKING:  # they import this module to train, which takes torch
    from hlp.models.classifier import ClassifierSettings
    from hlp.models.network_encoders import AutoencoderSettings, ContrastiveSettings


class OneCycleModule(pl.LightningModule):
    """A network in training by AdamW; the rate rises during the first share `rise` of all steps."""

    network: Any
    """The network: layers that are applied one after the other."""

    def __init__(self, learning_rate: float, weight_decay: float, rise: float) -> None:
        super().__init__()
        self.learning_rate, self.weight_decay, self.rise = learning_rate, weight_decay, rise

    def images(self, batch: Any) -> Tensor:
        """The network's input (n, c, p, p) for a batch."""
        raise NotImplementedError

    def adamw(self) -> AdamW:
        """The optimizer of all parameters, at its highest rate."""
        return AdamW(self.parameters(), lr=self.learning_rate, weight_decay=self.weight_decay)

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """AdamW with one cycle over the whole training."""
        steps = int(self.trainer.estimated_stepping_batches)
        return one_cycle(self.adamw(), self.learning_rate, steps, self.rise)

    def log_means(self, values: dict[str, Tensor], batch_size: int | None = None) -> None:
        """Log the means over each epoch."""
        self.log_dict(values, on_step=False, on_epoch=True, batch_size=batch_size)


def one_cycle(
    optimizer: Optimizer, learning_rate: float, steps: int, rise: float
) -> OptimizerLRScheduler:
    """The optimizer with one cycle over all `steps`: up to the rate, then down to nothing."""
    if rise * steps == 1.0:  # OneCycleLR would divide by the length of the rise, 0
        rise *= 2.0
    schedule = OneCycleLR(optimizer, learning_rate, total_steps=steps, pct_start=rise)
    return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


class HolisticCNN(nn.Sequential):
    """Strided convolutions, then two dense layers: (n, c, 64, 64) in [-1, 1] → (n, classes).

    The result are scores before the softmax.
    """

    head: nn.Sequential

    def __init__(
        self, channels: int, classes: int, widths: Sequence[int], hidden: int, dropout: float
    ) -> None:
        layers: list[nn.Module] = []
        for depth, (before, width) in enumerate(pairwise((channels, *widths))):
            kernel = 5 if depth == 0 else 3
            layers += [
                nn.Conv2d(before, width, kernel, stride=2, padding=kernel // 2, bias=False),
                nn.BatchNorm2d(width),
                nn.ReLU(inplace=True),
            ]
        side = classifier.RESOLUTION // 2 ** len(widths)
        head = nn.Sequential(
            nn.Flatten(),
            nn.Dropout(dropout),
            nn.Linear(widths[-1] * side * side, hidden),
            nn.ReLU(inplace=True),
            nn.Dropout(dropout),
            nn.Linear(hidden, classes),
        )
        super().__init__(OrderedDict(features=nn.Sequential(*layers), head=head))


class HolisticClassifier(OneCycleModule):
    """Trains `HolisticCNN` by cross-entropy. Class 0 is background."""

    def __init__(self, settings: "ClassifierSettings", channels: int, classes: int) -> None:
        super().__init__(settings.learning_rate, settings.weight_decay, rise=0.2)
        layers = settings.widths, settings.hidden, settings.dropout
        self.network = HolisticCNN(channels, classes, *layers)

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
    last = network.head[-1]
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


class PatchEncoder(nn.Sequential):
    """Strided convolutions and a dense layer: (n, 4, 32, 32) in [-1, 1] → (n, dimension)."""

    def __init__(self, widths: Sequence[int], dimension: int) -> None:
        layers: list[nn.Module] = []
        for before, width in pairwise((4, *widths)):
            layers += [
                nn.Conv2d(before, width, 3, stride=2, padding=1),
                nn.BatchNorm2d(width),
                nn.LeakyReLU(0.1, inplace=True),
            ]
        side = encoder.RESOLUTION // 2 ** len(widths)
        dense = nn.Linear(widths[-1] * side**2, dimension)
        parts = OrderedDict(convolutions=nn.Sequential(*layers), flat=nn.Flatten(), dense=dense)
        super().__init__(parts)


class PatchDecoder(nn.Sequential):
    """The mirror image of `PatchEncoder`: (n, dimension) → (n, 4, 32, 32) in [-1, 1].

    `widths` are the encoder's.
    """

    def __init__(self, widths: Sequence[int], dimension: int) -> None:
        side = encoder.RESOLUTION // 2 ** len(widths)
        back = tuple(widths)[::-1]
        expand = nn.Linear(dimension, back[0] * side**2)
        layers: list[nn.Module] = []
        for width, following in zip(back, (*back[1:], 4), strict=True):
            layers += [nn.ConvTranspose2d(width, following, 4, stride=2, padding=1)]
            layers += [nn.LeakyReLU(0.1, inplace=True)]
        convolutions = nn.Sequential(*layers[:-1], nn.Tanh())
        square = nn.Unflatten(1, (back[0], side, side))
        super().__init__(OrderedDict(expand=expand, square=square, convolutions=convolutions))


class ContrastiveEncoder(OneCycleModule):
    """Trains `PatchEncoder` so that the patches of a pair are each other's nearest neighbours."""

    def __init__(self, settings: "ContrastiveSettings") -> None:
        super().__init__(settings.learning_rate, settings.weight_decay, rise=0.1)
        self.settings = settings
        self.network = PatchEncoder(settings.widths, settings.dimension)

    def images(self, batch: dict[str, Any]) -> Tensor:
        """The network's input (2n, 4, p, p) for a batch: the noisy patches, then the clean ones."""
        images = [
            encoder_input(color, depth, valid, self.settings.input)
            for color, depth, valid in (batch["noisy"], batch["clean"])
        ]
        return torch.cat(images).contiguous(memory_format=torch.channels_last)

    def training_step(self, batch: dict[str, Any], _: int) -> Tensor:
        """Symmetric InfoNCE of one batch; logs loss and retrieval accuracy per epoch."""
        both = self.images(batch)
        noisy, clean = functional.normalize(self.network(both).float(), dim=1).chunk(2)
        logits = noisy @ clean.T / self.settings.temperature
        logits = logits.masked_fill(self._near(batch), float("-inf"))
        own = torch.arange(len(logits), device=logits.device)
        loss = (functional.cross_entropy(logits, own) + functional.cross_entropy(logits.T, own)) / 2
        accuracy = (logits.argmax(dim=1) == own).float().mean()
        self.log_means({"loss": loss, "accuracy": accuracy}, batch_size=len(logits))
        return loss

    def _near(self, batch: dict[str, Any]) -> Tensor:
        """Pairs (n, n) that look too alike to be negatives; never the diagonal."""
        same = batch["object_ids"][:, None] == batch["object_ids"]
        apart = torch.cdist(batch["points_obj"], batch["points_obj"]) * 1000.0
        flat = batch["rotations"].flatten(1)
        limit = 1.0 + 2.0 * torch.cos(torch.deg2rad(torch.tensor(self.settings.exclude_deg)))
        turned = flat @ flat.T
        near = same & (apart < self.settings.exclude_mm) & (turned > limit)
        return torch.as_tensor(near & ~torch.eye(len(near), dtype=torch.bool, device=near.device))


class Autoencoder(OneCycleModule):
    """Encoder to a feature and mirrored decoder back to the patch; trained on the squared error."""

    def __init__(self, settings: "AutoencoderSettings") -> None:
        super().__init__(settings.learning_rate, settings.weight_decay, rise=0.1)
        self.settings = settings
        self.network = PatchEncoder(settings.widths, settings.dimension)
        self.decoder = PatchDecoder(settings.widths, settings.dimension)

    def forward(self, images: Tensor) -> Tensor:
        """Reconstruction (n, 4, 32, 32) in [-1, 1]."""
        return torch.as_tensor(self.decoder(self.network(images)))

    def images(self, batch: dict[str, Tensor]) -> Tensor:
        """The network's input (n, 4, p, p) for a batch, as the patches were cut."""
        return self._images(batch["color"].permute(0, 3, 1, 2).float() / 255.0, batch)

    def _images(self, color: Tensor, batch: dict[str, Tensor]) -> Tensor:
        depth, valid = batch["depth"].float(), batch["valid"]
        images = encoder_input(color, depth, valid, self.settings.input)
        return images.contiguous(memory_format=torch.channels_last)

    def training_step(self, batch: dict[str, Tensor], _: int) -> Tensor:
        """Mean squared error of one batch; from its colour under another light, if it has one."""
        images = self.images(batch)
        seen = self._images(batch["seen"], batch) if "seen" in batch else images
        loss = functional.mse_loss(self(seen).float(), images)
        self.log_means({"loss": loss})
        return loss

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """AdamW at a constant rate, or with one cycle over the whole training."""
        return super().configure_optimizers() if self.settings.one_cycle else self.adamw()


def encoder_input(color: Tensor | None, depth: Tensor, valid: Tensor, kind: str) -> Tensor:
    """Channels (n, 4, p, p) in [-1, 1] of colour (n, 3, p, p) in 0…1 and depth, valid (n, p, p).

    The kinds are those of `patch_input`.
    """
    if kind == "rgbd":
        assert color is not None
        return torch.cat([color * 2.0 - 1.0, depth[:, None]], dim=1)
    images = normals_with_depth(depth.cpu().numpy(), valid.cpu().numpy())
    # Channels stay last in memory, which is fastest for the network.
    return torch.from_numpy(images).permute(0, 3, 1, 2).to(depth.device)
