"""Stages that learn the objects: views, classifier, encoder, codebooks. Each is made once."""

import gc
import logging
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch

from hlp.codebook.entries import load_codebook, save_codebook
from hlp.config.settings import RunSettings, result_settings
from hlp.data.dataset import Dataset, frames_identity
from hlp.method.codebook_building import build_codebook
from hlp.method.encoders import load_encoder, train_encoder
from hlp.method.training import fit, load_weights, read_weights
from hlp.models.classifier import HolisticClassifier, HolisticCNN, copy_weights
from hlp.models.encoder import Encoder
from hlp.patches.holistic_data import HolisticDataModule
from hlp.patches.holistic_pool import (
    BackgroundPool,
    HolisticPool,
    bake_backgrounds,
    bake_windows,
    join_pools,
)
from hlp.records import Codebook, Views
from hlp.rendering.views import load_views, render_views, save_views
from hlp.stages.fingerprint import fingerprint
from hlp.stages.store import Output, StageStore
from hlp.stages.warm_start import WarmStart, read_warm_start

VERSIONS = {"views": 1, "classifier": 2, "encoder": 2, "codebook": 3}


class TrainingStages:
    """Makes what is learnt from the objects' models, or finds it on disk.

    Each stage's fingerprint holds exactly the settings and inputs that its `make` is handed.
    """

    def __init__(self, dataset: Dataset, settings: RunSettings, store: StageStore) -> None:
        self.dataset = dataset
        self.settings = settings
        self.store = store
        self._made: dict[tuple[str, int], Output] = {}

    @property
    def made(self) -> Mapping[tuple[str, int], Output]:
        """The outputs asked for so far, by stage and object (0: of all)."""
        return dict(self._made)

    def adopt(self, made: Mapping[tuple[str, int], Output]) -> None:
        """Take outputs that another training of the same settings has made or found."""
        self._made |= made

    def views(self, object_id: int) -> Output:
        """Stage 0: RGB-D views of one object."""
        settings, seed = self.settings.rendering, self.settings.seed
        model = self.dataset.models[object_id]

        def make(folder: Path) -> None:
            save_views(folder, render_views(model, settings, seed))

        return self._stage("views", object_id, *self._views_inputs(object_id), make)

    def _views_inputs(self, object_id: int) -> tuple[Mapping[str, Any], Mapping[str, str]]:
        """Settings and upstream of an object's views."""
        upstream = {"mesh": self.dataset.mesh_identities[object_id]}
        return result_settings(self.settings.rendering), upstream

    def missing_views(self) -> list[int]:
        """Objects whose views are not on disk."""
        names = {i: self._name("views", *self._views_inputs(i)) for i in self.dataset.models}
        return [i for i, name in names.items() if not self.store.holds("views", name)]

    def take_views(self, object_id: int) -> None:
        """Views that a worker of this run has just put on disk."""
        name = self._name("views", *self._views_inputs(object_id))
        folder = self.store.take("views", name, self.dataset.models[object_id].name, reused=False)
        self._made["views", object_id] = Output(name, folder)

    def load_views(self, object_id: int) -> Views:
        """Views of one object, from disk."""
        return load_views(self.views(object_id).folder)

    def classifier(self) -> Output:
        """Stage 1: the holistic classifier of all objects."""
        patches = self.settings.patches
        sizes = {str(i): m.holistic_size for i, m in sorted(self.dataset.models.items())}
        upstream = {f"views_{i}": self.views(i).fingerprint for i in self.dataset.models}
        upstream["photographs"] = self.dataset.photographs_identity
        upstream["background_frames"] = frames_identity(self.dataset.background_frames)
        settings = {
            "holistic": result_settings(patches.holistic),
            "pool": result_settings(patches.pool),
            "classifier": result_settings(self.settings.classifier),
            "trainer": result_settings(self.settings.trainer),
            "sizes": sizes,
        }
        if self._warm_start is not None:
            settings["warm_start"] = {"epochs": self.settings.warm_start.epochs}
            upstream["warm_start"] = self._warm_start.classifier.fingerprint

        def make(folder: Path) -> None:
            self._train_classifier(folder)
            gc.collect()  # trainer, loader and data hold each other: a gigabyte for 15 objects

        return self._stage("classifier", 0, settings, upstream, make)

    @cached_property
    def _warm_start(self) -> WarmStart | None:
        """What is gone on from; None where everything is learnt from nothing."""
        manifest = self.settings.warm_start.manifest
        if manifest is None:
            return None
        views = {i: self.views(i).fingerprint for i in self.dataset.models}
        return read_warm_start(Path(manifest), self.settings, views, self.store)

    def _train_classifier(self, folder: Path) -> None:
        settings, patches = self.settings.classifier, self.settings.patches
        logging.getLogger(__name__).info("cutting windows of %d objects", len(self.dataset.models))
        data = HolisticDataModule(
            self._bake_windows(),
            self._bake_backgrounds(),
            patches.holistic.channels,
            patches.pool.background_share,
            settings.batch_size,
            self.settings.seed,
            self.settings.machine.threads,
        )
        torch.manual_seed(self.settings.seed)
        module = HolisticClassifier(settings, self._channels(), len(self.dataset.models) + 1)
        epochs = settings.epochs
        if self._warm_start is not None:
            weights = read_weights(self._warm_start.classifier.folder)
            copy_weights(module.network, weights, self._warm_start.labels)
            epochs = self.settings.warm_start.epochs
        fit(module, data, module.network, epochs, self.settings.trainer, folder)

    def _holistic_sizes(self) -> list[float]:
        return [model.holistic_size for _, model in sorted(self.dataset.models.items())]

    def _bake_windows(self) -> HolisticPool:
        patches = self.settings.patches
        pools = []
        for label, (object_id, model) in enumerate(sorted(self.dataset.models.items()), start=1):
            pool = bake_windows(
                self.load_views(object_id),
                label,
                model.holistic_size,
                self._holistic_sizes(),
                model.centroid,
                patches.holistic.resolution,
                patches.pool,
                np.random.default_rng([self.settings.seed, object_id]),
            )
            pools.append(pool)
        return join_pools(pools)

    def _bake_backgrounds(self) -> BackgroundPool:
        resolution = self.settings.patches.holistic.resolution
        count = self.settings.patches.pool.backgrounds
        rng = np.random.default_rng([self.settings.seed, 0])
        crops = self.dataset.photograph_crops(count, resolution, rng)
        source = self.dataset.background_frames
        frames = [] if source is None else [source.load(key) for key in source.keys]
        return bake_backgrounds(crops, frames, self._holistic_sizes(), resolution, count, rng)

    def _channels(self) -> int:
        return 4 if self.settings.patches.holistic.channels == "rgbd" else 3

    def load_classifier(self) -> HolisticCNN:
        """The trained classifier, from disk; class i is the i-th object by id, 0 background."""
        settings = self.settings.classifier
        network = HolisticCNN(
            self._channels(),
            len(self.dataset.models) + 1,
            settings.widths,
            settings.hidden,
            settings.dropout,
        )
        load_weights(network, self.classifier().folder)
        network.eval()
        network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        return network

    def encoder(self) -> Output:
        """Stage 2: the encoder of local patches, shared by all objects."""
        if self._warm_start is not None and ("encoder", 0) not in self._made:
            kept = self._warm_start.encoder
            self.store.take("encoder", kept.fingerprint, "", reused=True)
            self._made["encoder", 0] = kept
        if ("encoder", 0) in self._made:
            return self._made["encoder", 0]
        patches = self.settings.patches
        settings = {
            "encoder": result_settings(self.settings.encoder),
            "local": result_settings(patches.local),
            "trainer": result_settings(self.settings.trainer),
            "sizes": {str(i): m.local_size for i, m in sorted(self.dataset.models.items())},
        }
        if self.settings.encoder.name == "cae":
            upstream = {"encoder_frames": frames_identity(self.dataset.encoder_frames)}
        else:
            settings["pairs"] = result_settings(patches.pairs)
            upstream = {f"views_{i}": self.views(i).fingerprint for i in self.dataset.models}

        def make(folder: Path) -> None:
            train_encoder(self.dataset, self.settings, self.load_views, folder)
            gc.collect()  # as after the classifier

        return self._stage("encoder", 0, settings, upstream, make)

    def load_encoder(self) -> Encoder:
        """The trained encoder, from disk."""
        return load_encoder(
            self.settings.encoder, self.encoder().folder, self.settings.machine.device
        )

    def codebook(self, object_id: int) -> Output:
        """Stage 2: features of one object's views with what they vote for."""
        patches = self.settings.patches
        settings = {
            "local": result_settings(patches.local),
            "entries": result_settings(patches.entries),
            "size": self.dataset.models[object_id].local_size,
        }
        upstream = {
            "views": self.views(object_id).fingerprint,
            "encoder": self.encoder().fingerprint,
        }

        def make(folder: Path) -> None:
            views, model = self.load_views(object_id), self.dataset.models[object_id]
            made = build_codebook(model, views, self.load_encoder(), self.settings)
            save_codebook(folder, made)

        return self._stage("codebook", object_id, settings, upstream, make)

    def load_codebook(self, object_id: int) -> Codebook:
        """One object's codebook, from disk."""
        return load_codebook(self.codebook(object_id).folder)

    def _stage(
        self,
        stage: str,
        object_id: int,
        settings: Mapping[str, Any],
        upstream: Mapping[str, str],
        make: Callable[[Path], None],
    ) -> Output:
        if (stage, object_id) not in self._made:
            name = self._name(stage, settings, upstream)
            described = {"settings": settings, "upstream": upstream, "seed": self.settings.seed}
            of = self.dataset.models[object_id].name if object_id else ""
            folder = self.store.get_or_make(stage, name, make, described, of)
            self._made[stage, object_id] = Output(name, folder)
        return self._made[stage, object_id]

    def _name(self, stage: str, settings: Mapping[str, Any], upstream: Mapping[str, str]) -> str:
        return fingerprint(stage, VERSIONS[stage], self.settings.seed, settings, upstream)
