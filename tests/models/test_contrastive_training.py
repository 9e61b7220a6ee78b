import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from scipy.special import logsumexp

from hlp.models.encoder import patch_input
from hlp.models.encoder_training import ContrastiveEncoder, encoder_input
from hlp.models.network_encoders import ContrastiveSettings
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
