"""Batches from arrays in memory, in an order that depends on seed and epoch only.

Processes that train together (Lightning's DDP) each take a part of every batch and average their
gradients. For losses that are means over samples, and batches that divide evenly, that is the
gradient of the whole batch. It is not for a contrastive loss, whose negatives come from one part.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytorch_lightning as pl
import torch
from torch import Tensor, distributed
from torch.utils.data import DataLoader, Sampler, StackDataset

Batch = dict[str, Tensor]


class PoolDataModule(pl.LightningDataModule):
    """Batches of a pool of arrays of equal length, without the last, incomplete batch.

    A pool smaller than a batch gives one batch of all rows.
    """

    def __init__(self, pool: dict[str, np.ndarray], batch_size: int, seed: int) -> None:
        super().__init__()
        self.pool = {name: torch.from_numpy(values) for name, values in pool.items()}
        self.batch_size = batch_size
        self.seed = seed

    def train_dataloader(self) -> DataLoader[Batch]:
        """Batches in an order that depends on seed and epoch only."""
        rows = len(next(iter(self.pool.values())))
        sampler = _EpochBatches(rows, self.batch_size, self.seed)
        # An item is a whole batch: a tensor gives several rows at once.
        batches: Any = StackDataset(**self.pool)  # type: ignore[arg-type]
        return DataLoader(batches, sampler=sampler, batch_size=None)

    @property
    def batch_number(self) -> int:
        """Number of the current batch, unique across processes, as a seed of its random draws."""
        trainer = self.trainer
        if trainer is None:
            return 0
        return trainer.global_step * trainer.world_size + trainer.global_rank


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
        rank, processes = 0, 1
        if distributed.is_available() and distributed.is_initialized():
            rank, processes = distributed.get_rank(), distributed.get_world_size()
        for start in range(0, len(self) * self.batch_size, self.batch_size):
            yield order[start : start + self.batch_size][rank::processes]
