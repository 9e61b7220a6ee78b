"""Convolutional autoencoder of local RGB-D patches (paper, section 3.2, Fig. 6)."""

import pytorch_lightning as pl
import torch
from pytorch_lightning.utilities.types import OptimizerLRScheduler
from torch import Tensor
from torch.nn import functional

from hlp.models.autoencoder import AutoencoderSettings
from hlp.models.one_cycle import one_cycle
from hlp.models.patch_decoder import PatchDecoder
from hlp.models.patch_encoder import PatchEncoder
from hlp.models.training_input import encoder_input


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
