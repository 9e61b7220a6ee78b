from dataclasses import replace

import pytest
import pytorch_lightning as pl
import torch
from torch.utils.data import DataLoader

from hlp.models.encoder_training import Autoencoder
from hlp.models.network_encoders import AutoencoderSettings

# Steps are called without a trainer: their logging has nowhere to go, and says so.
pytestmark = pytest.mark.filterwarnings("ignore:.*self.trainer.*:UserWarning")

SETTINGS = AutoencoderSettings("cae", "rgbd", 16, (8, 16), 3e-3, 0.0, 1, 32, 100)


def make_batch(count=32):
    """Patches of smooth colour and tilted depth."""
    gen = torch.Generator().manual_seed(0)
    axis = torch.linspace(-1, 1, 32)
    slope = torch.rand((count, 1, 1), generator=gen) - 0.5
    depth = (slope * axis).expand(count, 32, 32).contiguous()
    color = torch.rand((count, 1, 1, 3), generator=gen).expand(count, 32, 32, 3) * 255
    return {
        "color": color.to(torch.uint8),
        "depth": depth,
        "valid": torch.ones_like(depth, dtype=torch.bool),
    }


@pytest.mark.parametrize("widths", [(8, 16), (4, 8, 8, 16)])
def test_a_reconstruction_has_the_shape_of_its_patch(widths):
    images = Autoencoder(replace(SETTINGS, widths=widths))(torch.rand(2, 4, 32, 32))
    assert images.shape == (2, 4, 32, 32) and images.abs().max() <= 1


def test_loss_is_the_mean_squared_error_of_colour_and_depth():
    torch.manual_seed(0)
    module = Autoencoder(SETTINGS).eval()
    batch = make_batch(4)
    color = batch["color"].permute(0, 3, 1, 2) / 127.5 - 1
    images = torch.cat([color, batch["depth"][:, None]], dim=1)
    expected = ((module(images) - images) ** 2).mean()
    torch.testing.assert_close(module.training_step(batch, 0), expected)


def test_patches_under_another_light_are_to_become_the_patches_as_they_were():
    torch.manual_seed(0)
    module = Autoencoder(SETTINGS).eval()
    batch = make_batch(4)
    seen = torch.rand((4, 3, 32, 32), generator=torch.Generator().manual_seed(1))
    depth = batch["depth"][:, None]
    given = torch.cat([seen * 2 - 1, depth], dim=1)
    wanted = torch.cat([batch["color"].permute(0, 3, 1, 2) / 127.5 - 1, depth], dim=1)
    expected = ((module(given) - wanted) ** 2).mean()
    torch.testing.assert_close(module.training_step({**batch, "seen": seen}, 0), expected)


@pytest.mark.parametrize("one_cycle", [False, True])
def test_the_rate_is_constant_or_falls_to_nothing(one_cycle):
    settings = replace(SETTINGS, one_cycle=one_cycle)
    module = Autoencoder(settings)
    trainer = pl.Trainer(
        accelerator="cpu", max_epochs=20, logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip
    trainer.fit(module, DataLoader([make_batch()], batch_size=None))
    (optimizer,) = trainer.optimizers
    rate = optimizer.param_groups[0]["lr"]
    assert rate < settings.learning_rate / 100 if one_cycle else rate == settings.learning_rate
