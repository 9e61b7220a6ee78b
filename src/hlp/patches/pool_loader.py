"""Batches from arrays in memory, in an order that depends on seed and epoch only.

Processes that train together (Lightning's DDP) each take a part of every batch and average their
gradients. For losses that are means over samples, and batches that divide evenly, that is the
gradient of the whole batch. It is not for a contrastive loss, whose negatives come from one part.
"""

from collections.abc import Iterator, Mapping

import pytorch_lightning as pl
import torch
from torch import Tensor, distributed
from torch.utils.data import DataLoader, Dataset, Sampler

Batch = dict[str, Tensor]


class _PoolDataset(Dataset[Batch]):
    """An item is a whole batch, gathered by its rows."""

    def __init__(self, pool: Mapping[str, Tensor]) -> None:
        self.pool = dict(pool)

    def __getitem__(self, rows: Tensor) -> Batch:
        return {name: values[rows] for name, values in self.pool.items()}


class _EpochBatches(Sampler[Tensor]):
    """Permuted batches of rows. Lightning calls `set_epoch`, so resumed runs get the same order."""

    def __init__(self, rows: int, batch_size: int, seed: int) -> None:
        self.rows, self.batch_size, self.seed, self.epoch = rows, batch_size, seed, 0

    def set_epoch(self, epoch: int) -> None:
        self.epoch = epoch

    def __len__(self) -> int:
        return max(1, self.rows // self.batch_size)

    def __iter__(self) -> Iterator[Tensor]:
        gen = torch.Generator().manual_seed(self.seed * 100_003 + self.epoch)
        order = torch.randperm(self.rows, generator=gen)
        rank, processes = _rank_and_processes()
        for start in range(0, len(self) * self.batch_size, self.batch_size):
            yield order[start : start + self.batch_size][rank::processes]


def _rank_and_processes() -> tuple[int, int]:
    """This process's rank among those that train together, and their number."""
    if distributed.is_available() and distributed.is_initialized():
        return distributed.get_rank(), distributed.get_world_size()
    return 0, 1


def batch_number(trainer: pl.Trainer | None) -> int:
    """Number of the current batch, unique across processes, as a seed of its random draws."""
    if trainer is None:
        return 0
    return trainer.global_step * trainer.world_size + trainer.global_rank


def pool_loader(pool: Mapping[str, Tensor], batch_size: int, seed: int) -> DataLoader[Batch]:
    """Batches of a pool of tensors of equal length, without the last, incomplete batch.

    A pool smaller than a batch gives one batch of all rows.
    """
    rows = len(next(iter(pool.values())))
    sampler = _EpochBatches(rows, batch_size, seed)
    return DataLoader(_PoolDataset(pool), sampler=sampler, batch_size=None)
