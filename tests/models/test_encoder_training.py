"""Losses and learning rates of the contrastive encoder and of the autoencoder."""

from dataclasses import replace

import numpy as np
import pytest
import pytorch_lightning as pl
import torch
from scipy.spatial.transform import Rotation
from scipy.special import logsumexp
from torch.utils.data import DataLoader

from hlp.models.encoder import patch_input
from hlp.models.encoder_training import Autoencoder, ContrastiveEncoder, encoder_input
from hlp.models.network_encoders import AutoencoderSettings, ContrastiveSettings
from view_records import random_patches

# Steps are called without a trainer: their logging has nowhere to go, and says so.
pytestmark = pytest.mark.filterwarnings("ignore:.*self.trainer.*:UserWarning")

SETTINGS = ContrastiveSettings(
    "contrastive", "normals_depth", 12, (6, 8), 0.1, 15.0, 20.0, 3e-3, 0.0, 1, 8
)
COUNT = 8


def make_batch(seed=0):
    gen = torch.Generator().manual_seed(seed)
    valid = torch.ones((COUNT, 32, 32), dtype=torch.bool)

    def side(noise):
        depth = clean + noise * torch.randn((COUNT, 32, 32), generator=gen)
        return torch.rand((COUNT, 3, 32, 32), generator=gen), depth.clamp(-1, 1), valid

    coarse = torch.randn((COUNT, 1, 4, 4), generator=gen)
    clean = torch.nn.functional.interpolate(coarse, (32, 32), mode="bilinear")[:, 0] * 0.3
    rotations = Rotation.random(COUNT, random_state=seed).as_matrix()
    return {
        "noisy": side(0.02),
        "clean": side(0.0),
        "object_ids": torch.arange(COUNT),
        "points_obj": torch.rand((COUNT, 3), generator=gen),
        "rotations": torch.from_numpy(rotations).float(),
    }


def reference(module, batch, excluded=()):
    """Symmetric InfoNCE, written out with loops, without the `excluded` pairs (i, j)."""
    with torch.no_grad():
        images = torch.cat([encoder_input(*batch[s], SETTINGS.input) for s in ("noisy", "clean")])
        features = module.network(images).numpy().astype(np.float64)
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    noisy, clean = features[:COUNT], features[COUNT:]
    losses = []
    for i in range(COUNT):
        others = [j for j in range(COUNT) if (i, j) not in excluded]
        forth = [noisy[i] @ clean[j] / SETTINGS.temperature for j in others]
        back = [clean[i] @ noisy[j] / SETTINGS.temperature for j in others]
        own = noisy[i] @ clean[i] / SETTINGS.temperature
        losses += [logsumexp(forth) - own, logsumexp(back) - own]
    return np.mean(losses)


def loss_of(module, batch):
    return module.training_step(batch, 0).item()


@pytest.fixture
def module():
    torch.manual_seed(0)
    return ContrastiveEncoder(SETTINGS).eval()


def test_loss_is_symmetric_infonce(module):
    batch = make_batch()
    assert loss_of(module, batch) == pytest.approx(reference(module, batch), rel=1e-4)


def turned(rotation, degrees):
    return torch.from_numpy(Rotation.from_euler("y", degrees, degrees=True).as_matrix()).float() @ (
        rotation
    )


# object, distance (mm), angle (degrees) of pairs 0 and 1; are they too alike to be told apart?
CASES = [
    (0, 14.0, 19.0, True),
    (0, 16.0, 19.0, False),
    (0, 14.0, 21.0, False),
    (1, 14.0, 19.0, False),
]


@pytest.mark.parametrize(("other", "millimetres", "degrees", "near"), CASES)
def test_near_neighbours_of_one_object_are_no_negatives(module, other, millimetres, degrees, near):
    batch = make_batch()
    batch["object_ids"][1] = other
    batch["points_obj"][1] = batch["points_obj"][0] + torch.tensor([0.0, millimetres / 1000, 0.0])
    batch["rotations"][1] = turned(batch["rotations"][0], degrees)
    excluded = {(0, 1), (1, 0)} if near else set()
    found = loss_of(module, batch)
    assert found == pytest.approx(reference(module, batch, excluded), rel=1e-4)
    if near:
        assert found < reference(module, batch) - 1e-4


def test_a_pair_is_never_its_own_neighbour(module):
    batch = make_batch()
    batch["object_ids"][:] = 3
    batch["points_obj"][:] = 0.0
    batch["rotations"][:] = torch.eye(3)
    assert loss_of(module, batch) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("kind", ["rgbd", "normals_depth"])
def test_training_sees_patches_as_detection_does(kind):
    patches = random_patches(5, seed=1)
    levels = torch.from_numpy(patches.color).permute(0, 3, 1, 2) / 255.0
    depth, valid = torch.from_numpy(patches.depth), torch.from_numpy(patches.valid)
    found = encoder_input(levels, depth, valid, kind)
    assert found.shape == (5, 4, 32, 32)
    expected = patch_input(patches, kind).transpose(0, 3, 1, 2)
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-6)


CAE = AutoencoderSettings("cae", "rgbd", 16, (8, 16), 3e-3, 0.0, 1, 32, 100)


def smooth_patches(count=32):
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
    images = Autoencoder(replace(CAE, widths=widths))(torch.rand(2, 4, 32, 32))
    assert images.shape == (2, 4, 32, 32) and images.abs().max() <= 1


def test_loss_is_the_mean_squared_error_of_colour_and_depth():
    torch.manual_seed(0)
    module = Autoencoder(CAE).eval()
    batch = smooth_patches(4)
    color = batch["color"].permute(0, 3, 1, 2) / 127.5 - 1
    images = torch.cat([color, batch["depth"][:, None]], dim=1)
    expected = ((module(images) - images) ** 2).mean()
    torch.testing.assert_close(module.training_step(batch, 0), expected)


def test_patches_under_another_light_are_to_become_the_patches_as_they_were():
    torch.manual_seed(0)
    module = Autoencoder(CAE).eval()
    batch = smooth_patches(4)
    seen = torch.rand((4, 3, 32, 32), generator=torch.Generator().manual_seed(1))
    depth = batch["depth"][:, None]
    given = torch.cat([seen * 2 - 1, depth], dim=1)
    wanted = torch.cat([batch["color"].permute(0, 3, 1, 2) / 127.5 - 1, depth], dim=1)
    expected = ((module(given) - wanted) ** 2).mean()
    torch.testing.assert_close(module.training_step({**batch, "seen": seen}, 0), expected)


@pytest.mark.parametrize("one_cycle", [False, True])
def test_the_rate_is_constant_or_falls_to_nothing(one_cycle):
    settings = replace(CAE, one_cycle=one_cycle)
    module = Autoencoder(settings)
    trainer = pl.Trainer(
        accelerator="cpu", max_epochs=20, logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip
    trainer.fit(module, DataLoader([smooth_patches()], batch_size=None))
    (optimizer,) = trainer.optimizers
    rate = optimizer.param_groups[0]["lr"]
    assert rate < settings.learning_rate / 100 if one_cycle else rate == settings.learning_rate
