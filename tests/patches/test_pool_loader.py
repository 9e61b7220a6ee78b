import numpy as np
import pytest
import torch
from torch import distributed

from hlp.patches.pool_loader import PoolDataModule

POOL = {"row": np.arange(23), "square": np.arange(23) ** 2}


def pool_loader(pool, batch_size, seed):
    return PoolDataModule(pool, batch_size, seed).train_dataloader()


def epoch(loader, number):
    loader.sampler.set_epoch(number)
    return [batch["row"].tolist() for batch in loader]


def test_an_epoch_shows_every_row_once_but_for_the_incomplete_batch():
    batches = epoch(pool_loader(POOL, 5, 0), 0)
    assert [len(batch) for batch in batches] == [5] * 4
    assert len({row for batch in batches for row in batch}) == 20
    assert len(pool_loader(POOL, 5, 0)) == 4
    for batch in pool_loader(POOL, 5, 0):
        torch.testing.assert_close(batch["square"], batch["row"] ** 2)


def test_the_order_depends_on_seed_and_epoch_alone():
    first = epoch(pool_loader(POOL, 5, 3), 7)
    torch.rand(5)
    assert epoch(pool_loader(POOL, 5, 3), 7) == first
    assert epoch(pool_loader(POOL, 5, 3), 8) != first
    assert epoch(pool_loader(POOL, 5, 4), 7) != first


@pytest.mark.parametrize("size", [23, 100])
def test_a_pool_smaller_than_a_batch_is_one_batch(size):
    (batch,) = epoch(pool_loader(POOL, size, 0), 0)
    assert sorted(batch) == list(range(23))


def test_processes_that_train_together_share_out_each_batch(monkeypatch):
    whole = epoch(pool_loader(POOL, 5, 0), 3)
    monkeypatch.setattr(distributed, "is_initialized", lambda: True)
    monkeypatch.setattr(distributed, "get_world_size", lambda: 2)
    shares = []
    for rank in (0, 1):
        monkeypatch.setattr(distributed, "get_rank", lambda rank=rank: rank)
        shares.append(epoch(pool_loader(POOL, 5, 0), 3))
    for batch, first, second in zip(whole, *shares, strict=True):
        assert (batch[::2], batch[1::2]) == (first, second)
