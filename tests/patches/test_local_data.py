from types import SimpleNamespace

import numpy as np
import pytest
import torch
from scipy.ndimage import convolve

from hlp.patches import local_data
from hlp.patches.local_data import (
    PairDataModule,
    PatchDataModule,
    degrade_color,
    degrade_depth,
    degrade_patches,
)
from hlp.patches.local_pool import PairPool
from hlp.records import LocalPatches

COUNT, SIZE, METRIC = 150, 24, 0.06


def make_patches(seed=0):
    """Flat discs of random colours before the void."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:SIZE, :SIZE]
    valid = np.broadcast_to(np.hypot(x - 11.5, y - 11.5) < 9, (COUNT, SIZE, SIZE)).copy()
    color = np.where(valid[..., None], rng.integers(0, 256, (COUNT, 1, 1, 3)), 128)
    depth = np.where(valid, 0.0, 1.0).astype(np.float32)
    return LocalPatches(
        color.astype(np.uint8), depth, valid, rng.random((COUNT, 3)), rng.random((COUNT, 2))
    )


def make_pool():
    a, b = make_patches(0), make_patches(1)
    rng = np.random.default_rng(2)
    return PairPool(
        np.stack([a.color, b.color], axis=1),
        np.stack([a.depth, b.depth], axis=1).astype(np.float16),
        np.stack([a.valid, b.valid], axis=1),
        np.full(COUNT, METRIC, np.float32),
        np.arange(COUNT),
        rng.random((COUNT, 3)).astype(np.float32),
        rng.random((COUNT, 3, 3)).astype(np.float32),
    )


def degraded(seed=0):
    patches, gen = make_patches(), torch.Generator().manual_seed(seed)
    clean = torch.from_numpy(patches.color).permute(0, 3, 1, 2).float() / 255.0
    depth, valid, clutter = degrade_depth(
        torch.from_numpy(patches.depth),
        torch.from_numpy(patches.valid),
        torch.full((COUNT,), METRIC),
        gen,
    )
    return degrade_color(clean, valid, clutter, gen), depth, valid


def test_what_is_not_valid_is_filled_as_in_any_patch():
    color, depth, valid = degraded()
    np.testing.assert_allclose(color.permute(0, 2, 3, 1)[~valid], 128 / 255, atol=1e-6)
    assert (depth[~valid] == 1.0).all()
    assert depth[valid].abs().max() <= 1.0
    assert color.min() >= 0 and color.max() <= 1


def test_the_object_is_partly_occluded_and_clutter_appears():
    _, _, valid = degraded()
    clean = torch.from_numpy(make_patches().valid)
    lost = (clean & ~valid).float().mean(dim=(1, 2)) / clean.float().mean(dim=(1, 2))
    gained = (valid & ~clean).any(dim=2).any(dim=1).float().mean()
    assert 0.01 < float(lost.mean()) < 0.5
    assert 0.3 < float(gained) < 0.9
    assert valid[:, 11:13, 11:13].float().mean() > 0.85  # occluders spare the centre


def test_depth_noise_is_that_of_a_sensor():
    _, depth, valid = degraded()
    clean = torch.from_numpy(make_patches().valid)
    meters = depth[valid & clean] * METRIC / 2
    assert 0.0005 < float(meters.std()) < 0.005
    steps = [len(np.unique(d[v & c])) for d, v, c in zip(depth, valid, clean, strict=True)]
    assert np.median(steps) < 60  # quantised: of some 250 pixels many agree


def test_degraded_patches_of_a_codebook_keep_their_places():
    patches = make_patches()
    rows = np.array([5, 2, 90])
    seen = degrade_patches(patches, rows, METRIC, 7)
    np.testing.assert_array_equal(seen.points_cam, patches.points_cam[rows])
    assert seen.color.dtype == np.uint8 and seen.color.shape == (3, SIZE, SIZE, 3)
    assert (seen.color[~seen.valid] == 128).all()
    again = degrade_patches(patches, rows, METRIC, 7)
    np.testing.assert_array_equal(seen.depth, again.depth)
    np.testing.assert_array_equal(seen.color, again.color)


def pair_batch(data, step):
    data.trainer = SimpleNamespace(global_step=step, world_size=1, global_rank=0)
    return data.on_before_batch_transfer(next(iter(data.train_dataloader())), 0)


def test_a_pair_is_a_degraded_patch_and_the_clean_other_one():
    pool = make_pool()
    batch = pair_batch(PairDataModule(pool, True, 32, 0), 0)
    rows = batch["object_ids"].numpy()  # the pool's object ids are its rows
    color, depth, valid = batch["clean"]
    np.testing.assert_allclose(color.permute(0, 2, 3, 1) * 255, pool.color[rows, 1], atol=1e-4)
    np.testing.assert_array_equal(depth, pool.depth[rows, 1].astype(np.float32))
    np.testing.assert_array_equal(valid, pool.valid[rows, 1])
    np.testing.assert_array_equal(batch["points_obj"], pool.points_obj[rows])
    np.testing.assert_array_equal(batch["rotations"], pool.rotations[rows])
    noisy = batch["noisy"]
    assert noisy[1].shape == depth.shape
    assert (noisy[1] != depth).flatten(1).any(dim=1).all()


def test_the_same_seed_and_step_give_the_same_pairs_whatever_ran_before():
    first = pair_batch(PairDataModule(make_pool(), True, 32, 0), 9)
    data = PairDataModule(make_pool(), True, 32, 0)
    pair_batch(data, 8)
    torch.rand(3)
    again = pair_batch(data, 9)
    for one, other in zip(first["noisy"], again["noisy"], strict=True):
        assert torch.equal(one, other)
    assert not torch.equal(pair_batch(data, 10)["noisy"][1], first["noisy"][1])


def test_pairs_without_colour_have_the_same_shapes():
    colored = pair_batch(PairDataModule(make_pool(), True, 32, 0), 3)
    plain = pair_batch(PairDataModule(make_pool(), False, 32, 0), 3)
    assert plain["noisy"][0] is None and plain["clean"][0] is None
    for kind in ("noisy", "clean"):
        for one, other in zip(colored[kind][1:], plain[kind][1:], strict=True):
            assert torch.equal(one, other)


@pytest.mark.parametrize("size", [32, COUNT])
def test_patches_for_the_autoencoder_come_as_they_are(size):
    patches = make_patches()
    batches = list(PatchDataModule(patches, size, 0).train_dataloader())
    assert [len(batch["color"]) for batch in batches] == [size] * (COUNT // size)
    seen = torch.cat([batch["color"] for batch in batches]).numpy()
    known = {color.tobytes() for color in patches.color}
    assert {color.tobytes() for color in seen} <= known


def test_patches_under_another_light_keep_their_shape():
    patches = make_patches()
    data = PatchDataModule(patches, 32, 0, varied_light=True)
    plain = next(iter(PatchDataModule(patches, 32, 0).train_dataloader()))
    batch = pair_batch(data, 4)
    for key in ("color", "depth", "valid"):
        assert torch.equal(batch[key], plain[key])
    own = plain["color"].permute(0, 3, 1, 2).float() / 255.0
    assert batch["seen"].shape == own.shape and not torch.equal(batch["seen"], own)
    assert batch["seen"].min() >= 0 and batch["seen"].max() <= 1
    assert torch.equal(batch["seen"], pair_batch(data, 4)["seen"])  # the step decides
    assert not torch.equal(batch["seen"], pair_batch(data, 5)["seen"])


def generator():
    return torch.Generator().manual_seed(0)


def test_the_surface_keeps_black_black_and_a_grey_object_is_tinted_as_one():
    grey = torch.full((4, 3, 8, 8), 0.5)
    varied = local_data.vary_surface(grey, generator())
    assert float(varied.flatten(2).std(dim=2).max()) < 1e-6  # one colour over the whole object
    assert float(varied.mean(dim=(2, 3)).std()) > 0.05
    assert torch.equal(local_data.vary_surface(torch.zeros_like(grey), generator()), 0 * grey)


def test_blur_smooths_its_share_with_the_binomial_kernel():
    source = torch.rand((400, 3, 8, 8), generator=generator())
    blurred = local_data.blur(source, generator())
    line = np.array([0.25, 0.5, 0.25])
    kernel = np.outer(line, line)
    counts = {"sharp": 0, "once": 0, "twice": 0}
    for image, result in zip(source.numpy(), blurred.numpy(), strict=True):
        once = np.stack([convolve(c, kernel, mode="nearest") for c in image])
        twice = np.stack([convolve(c, kernel, mode="nearest") for c in once])
        for name, expected in (("sharp", image), ("once", once), ("twice", twice)):
            counts[name] += np.allclose(result, expected, atol=1e-5)
    assert sum(counts.values()) == 400
    assert counts["sharp"] == pytest.approx(200, abs=40)
    assert counts["once"] == pytest.approx(100, abs=35)
