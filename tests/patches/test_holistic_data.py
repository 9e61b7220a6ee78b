from types import SimpleNamespace

import numpy as np
import pytest
import torch

from hlp.patches.composite import BackgroundPool
from hlp.patches.holistic_data import HolisticDataModule
from hlp.patches.holistic_pool import BACKGROUND, HolisticPool

COUNT, SIZE, LABEL = 120, 16, 2


def make_pool(seed=0):
    """Objects as discs about the centre, of random colours."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:SIZE, :SIZE]
    mask = np.broadcast_to(np.hypot(x - 7.5, y - 7.5) < 6, (COUNT, SIZE, SIZE)).copy()
    color = rng.integers(0, 256, (COUNT, SIZE, SIZE, 3)).astype(np.uint8)
    depth = np.where(mask, rng.integers(100, 150, mask.shape), 255).astype(np.uint8)
    return HolisticPool(color, depth, mask, np.full(COUNT, LABEL, np.int64))


def make_backgrounds(seed=1):
    rng = np.random.default_rng(seed)
    color = rng.integers(0, 256, (20, SIZE, SIZE, 3)).astype(np.uint8)
    depth = rng.integers(1, 256, (20, SIZE, SIZE)).astype(np.uint8)
    depth[:10] = 0  # photographs
    return BackgroundPool(color, depth)


def module(pool, channels="rgbd", share=0.4, seed=0, backgrounds=None):
    backgrounds = make_backgrounds() if backgrounds is None else backgrounds
    return HolisticDataModule(pool, backgrounds, channels, share, 40, seed, threads=1)


def compose(data, seed=0):
    return data.compose(data.pool, np.random.default_rng(seed))


def test_background_alone_holds_no_pixel_of_the_object_and_is_labelled_so():
    first, labels = compose(module(make_pool(0)))
    second, same = compose(module(make_pool(1)))  # other objects, all else as before
    assert torch.equal(labels, same)
    alone = labels == BACKGROUND
    assert int(alone.sum()) == pytest.approx(0.4 * COUNT, abs=15)
    assert (labels[~alone] == LABEL).all()
    assert torch.equal(first[alone], second[alone])
    # Elsewhere the object shows, at the centre always: no occluder covers it.
    middle = (slice(None), slice(None), slice(7, 9), slice(7, 9))
    changed = (first[middle] != second[middle]).flatten(1).any(dim=1)
    assert changed[~alone].all()


def test_backgrounds_alone_have_their_windows_depth_in_the_middle():
    backgrounds = make_backgrounds()
    backgrounds.depth[10:, 7:9, 7:9] = 128  # measured: as windows are cut
    images, labels = compose(module(make_pool(), share=1.0, backgrounds=backgrounds))
    middle = images[:, 3, 7:9, 7:9].mean(dim=(1, 2))
    assert (labels == BACKGROUND).all()
    assert middle.abs().median() < 0.05
    # As for the objects: noise, a hole, or an occluder's edge at most.
    assert (middle.abs() < 0.25).float().mean() > 0.8


def test_the_same_seed_and_step_give_the_same_batch_whatever_ran_before():
    def batch(data, step):
        data.trainer = SimpleNamespace(global_step=step, world_size=1, global_rank=0)
        loader = data.train_dataloader()
        return data.on_before_batch_transfer(next(iter(loader)), 0)

    first = batch(module(make_pool()), 5)
    data = module(make_pool())
    batch(data, 4)
    torch.rand(7)
    for one, other in zip(first, batch(data, 5), strict=True):
        assert torch.equal(one, other)
    assert not torch.equal(batch(data, 6)[0], first[0])
    assert not torch.equal(batch(module(make_pool(), seed=1), 5)[0], first[0])
