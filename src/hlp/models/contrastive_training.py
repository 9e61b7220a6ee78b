"""Contrastive training of the local encoder, and that of the paper's autoencoder.

The two patches of a pair show the same surface point in neighbouring views, one clean and one
degraded. InfoNCE (van den Oord et al., 2018) replaces the paper's reconstruction objective:
reconstruction keeps light and clutter in the feature, InfoNCE removes them.
"""

from typing import Any

import pytorch_lightning as pl
import torch
from pytorch_lightning.utilities.types import OptimizerLRScheduler
from torch import Tensor
from torch.nn import functional

from hlp.models.autoencoder import AutoencoderSettings
from hlp.models.contrastive import ContrastiveSettings
from hlp.models.encoder import normals_with_depth, sees_color
from hlp.models.patch_encoder import PatchDecoder, PatchEncoder, one_cycle


class ContrastiveEncoder(pl.LightningModule):
    """Trains `PatchEncoder` so that the patches of a pair are each other's nearest neighbours."""

    def __init__(self, settings: ContrastiveSettings) -> None:
        super().__init__()
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
        self.log("loss", loss, on_step=False, on_epoch=True, prog_bar=True, batch_size=len(logits))
        self.log(
            "accuracy",
            accuracy,
            on_step=False,
            on_epoch=True,
            prog_bar=True,
            batch_size=len(logits),
        )
        return loss

    def _near(self, batch: dict[str, Any]) -> Tensor:
        """Pairs (n, n) that look too alike to be negatives; never the diagonal."""
        same = batch["object"][:, None] == batch["object"]
        apart = torch.cdist(batch["point"], batch["point"]) * 1000.0
        flat = batch["rotation"].flatten(1)
        limit = 1.0 + 2.0 * torch.cos(torch.deg2rad(torch.tensor(self.settings.exclude_deg)))
        turned = flat @ flat.T
        near = same & (apart < self.settings.exclude_mm) & (turned > limit)
        return torch.as_tensor(near & ~torch.eye(len(near), dtype=torch.bool, device=near.device))

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """AdamW with one cycle over the whole training."""
        settings = self.settings
        optimizer = torch.optim.AdamW(
            self.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
        )
        steps = self.trainer.estimated_stepping_batches
        return one_cycle(optimizer, settings.learning_rate, steps, 0.1)


class Autoencoder(pl.LightningModule):
    """Encoder to a feature and mirrored decoder back to the patch; trained on the squared error."""

    def __init__(self, settings: AutoencoderSettings) -> None:
        super().__init__()
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
        return encoder_input(
            color, batch["depth"].float(), batch["valid"], self.settings.input
        ).contiguous(memory_format=torch.channels_last)

    def training_step(self, batch: dict[str, Tensor], _: int) -> Tensor:
        """Mean squared error of one batch; from its colour under another light, if it has one."""
        images = self.images(batch)
        seen = self._images(batch["seen"], batch) if "seen" in batch else images
        loss = functional.mse_loss(self(seen).float(), images)
        self.log("loss", loss, on_step=False, on_epoch=True, prog_bar=True)
        return loss

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """AdamW at a constant rate, or with one cycle over the whole training."""
        settings = self.settings
        optimizer = torch.optim.AdamW(
            self.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
        )
        if not settings.one_cycle:
            return optimizer
        steps = self.trainer.estimated_stepping_batches
        return one_cycle(optimizer, settings.learning_rate, steps, 0.1)


def encoder_input(color: Tensor | None, depth: Tensor, valid: Tensor, kind: str) -> Tensor:
    """Channels (n, 4, p, p) in [-1, 1] of colour (n, 3, p, p) in 0…1 and depth, valid (n, p, p).

    The kinds are those of `patch_input`. Raises ValueError for another kind, and for `rgbd` without
    colour.
    """
    if sees_color(kind):
        if color is None:
            raise ValueError("the encoder's input 'rgbd' needs patches with colour")
        return torch.cat([color * 2.0 - 1.0, depth[:, None]], dim=1)
    images = normals_with_depth(depth.cpu().numpy(), valid.cpu().numpy())
    # Channels stay last in memory, which is fastest for the network.
    return torch.from_numpy(images).permute(0, 3, 1, 2).to(depth.device)
