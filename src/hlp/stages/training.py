"""Stages that learn the objects: views, classifier, encoder, codebooks. Each is made once.

Torch and Lightning, which take seconds to import, are imported when a stage is made.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from hlp.codebook.entries import load_codebook, save_codebook
from hlp.data.dataset import Dataset, frames_identity
from hlp.method.learn.model_files import StartingWeights, load_classifier, read_weights
from hlp.method.settings import (
    ClassifierStage,
    CodebookStage,
    EncoderStage,
    MethodSettings,
    ViewsStage,
)
from hlp.models.encoder import Encoder
from hlp.models.network import Network
from hlp.records import Codebook, ObjectModel, Views
from hlp.rendering.views import load_views, render_views, save_views
from hlp.stages.manifest import Description, described, device_name, fingerprint, stage_code
from hlp.stages.store import Output, StageStore
from hlp.stages.warm_start import WarmStart, WarmStartSettings, read_warm_start


class TrainingStages:
    """Learns the objects from their models, or reuses what was learnt before.

    Each stage's fingerprint holds exactly the settings and inputs that its `make` uses. `made` are
    the outputs used so far, by stage and object id (0: of all objects).
    """

    def __init__(
        self,
        dataset: Dataset,
        settings: MethodSettings,
        store: StageStore,
        warm_start: WarmStartSettings | None = None,
    ) -> None:
        self.dataset, self.settings, self.store = dataset, settings, store
        self.made: dict[tuple[str, int], Output] = {}
        self._warm_start_settings = warm_start

    @property
    def models(self) -> Mapping[int, ObjectModel]:
        """The objects that are learnt, by id."""
        return self.dataset.models

    @property
    def classes(self) -> Sequence[int]:
        """Object id of each class of the classifier, from class 1 on; class 0 is background."""
        return sorted(self.models)

    def make_for(self, object_ids: tuple[int, ...]) -> None:
        """Make everything that the detection of these objects loads, unless it is on disk."""
        self.classifier()
        self.encoder()
        for object_id in object_ids:
            self.codebook(object_id)

    def views(self, object_id: int) -> Output:
        """Stage 0: RGB-D views of one object."""
        stage, model = ViewsStage.of(self.settings), self.models[object_id]

        def make(folder: Path) -> None:
            views = render_views(model, stage.rendering, stage.seed, threads=stage.machine.threads)
            save_views(folder, views)

        return self._make_once("views", object_id, self._views_description(object_id), make)

    def _views_description(self, object_id: int) -> Description:
        upstream = {"mesh": self.dataset.mesh_identities[object_id]}
        settings = ViewsStage.of(self.settings).named()
        return self._description(settings, upstream, render_views.__module__)

    def missing_views(self) -> list[int]:
        """Objects whose views are not on disk."""
        names = {i: fingerprint("views", self._views_description(i)) for i in self.models}
        return [i for i, name in names.items() if self.store.problem("views", name)]

    def take_views(self, object_id: int) -> None:
        """Use views that a worker of this run has just written."""
        name = fingerprint("views", self._views_description(object_id))
        folder = self.store.take("views", name, self.models[object_id].name, reused=False)
        self.made["views", object_id] = Output(name, folder)

    def load_views(self, object_id: int) -> Views:
        """Views of one object, from disk."""
        return load_views(self.views(object_id).folder, object_id)

    def _all_views(self) -> dict[str, str]:
        return {f"views_{i}": self.views(i).fingerprint for i in self.models}

    def classifier(self) -> Output:
        """Stage 1: the holistic classifier of all objects."""
        dataset, stage, start = self.dataset, ClassifierStage.of(self.settings), None
        sizes = {str(i): m.holistic_size for i, m in sorted(self.models.items())}
        device = device_name(stage.trainer.accelerator)
        settings = {**stage.named(), "device": device, "sizes": sizes}
        upstream = {
            **self._all_views(),
            "photographs": dataset.photographs_identity,
            "background_frames": frames_identity(dataset.background_frames),
        }
        if self._warm_start is not None:
            before = self._warm_start.classifier
            settings["warm_start"] = {"epochs": self._warm_start.epochs}
            upstream["warm_start"] = before.fingerprint
            weights = read_weights(before.folder)
            start = StartingWeights(weights, self._warm_start.labels, self._warm_start.epochs)

        def make(folder: Path) -> None:
            from hlp.method.learn.classifier_training import train_classifier

            train_classifier(self.models, self.load_views, dataset, stage, folder, start)

        code = "hlp.method.learn.classifier_training", dataset, dataset.background_frames
        return self._make_once("classifier", 0, self._description(settings, upstream, *code), make)

    @cached_property
    def _warm_start(self) -> WarmStart | None:
        """What training starts from; None if everything is learnt from scratch."""
        given = self._warm_start_settings
        if given is None or given.manifest is None:
            return None
        views = {i: self.views(i).fingerprint for i in self.models}
        return read_warm_start(given, self.settings, views, self.store)

    def load_classifier(self) -> Network:
        """The trained classifier, from disk; class i is the i-th object by id, 0 background."""
        return load_classifier(self.classifier().folder, self.settings.machine)

    def encoder(self) -> Output:
        """Stage 2: the encoder of local patches, shared by all objects."""
        if self._warm_start is not None and ("encoder", 0) not in self.made:
            kept = self._warm_start.encoder
            self.store.take("encoder", kept.fingerprint, "", reused=True)
            self.made["encoder", 0] = kept
        if ("encoder", 0) in self.made:
            return self.made["encoder", 0]
        dataset, stage = self.dataset, EncoderStage.of(self.settings)
        code: tuple[object, ...] = "hlp.method.learn.encoder_training", stage.encoder
        sizes = {str(i): m.local_size for i, m in sorted(self.models.items())}
        device = device_name(stage.trainer.accelerator)
        settings = {**stage.named(), "device": device, "sizes": sizes}
        if stage.encoder.needs_frames:
            upstream = {
                "encoder_frames": frames_identity(dataset.encoder_frames),
                "background_frames": frames_identity(dataset.background_frames),
            }
            code += (dataset, dataset.encoder_frames, dataset.background_frames)
        else:
            upstream = self._all_views()

        def make(folder: Path) -> None:
            from hlp.method.learn.encoder_training import train_encoder

            train_encoder(self.models, self.load_views, dataset, stage, folder)

        return self._make_once("encoder", 0, self._description(settings, upstream, *code), make)

    def load_encoder(self) -> Encoder:
        """The trained encoder, from disk."""
        machine = self.settings.machine
        return self.settings.encoder.load(self.encoder().folder, machine.threads, machine.device)

    def codebook(self, object_id: int) -> Output:
        """Stage 2: the codebook of one object."""
        stage = CodebookStage.of(self.settings)
        size, device = self.models[object_id].local_size, device_name(self.settings.machine.device)
        settings = {**stage.named(), "size": size, "object_id": object_id, "device": device}
        views, encoder = self.views(object_id), self.encoder()
        upstream = {"views": views.fingerprint, "encoder": encoder.fingerprint}

        def make(folder: Path) -> None:
            from hlp.method.learn.codebook_building import build_codebook

            views, model = self.load_views(object_id), self.models[object_id]
            save_codebook(folder, build_codebook(model, views, self.load_encoder(), stage))

        code = "hlp.method.learn.codebook_building", save_codebook.__module__, self.settings.encoder
        description = self._description(settings, upstream, *code)
        return self._make_once("codebook", object_id, description, make)

    def load_codebook(self, object_id: int) -> Codebook:
        """One object's codebook, from disk."""
        return load_codebook(self.codebook(object_id).folder)

    def search_folder(self, object_ids: Sequence[int]) -> None:
        """None: a codebook's fingerprint excludes the search's settings, so none is stored."""

    def _make_once(
        self, stage: str, object_id: int, description: Description, make: Callable[[Path], None]
    ) -> Output:
        if (stage, object_id) not in self.made:
            name = fingerprint(stage, description)
            of = self.models[object_id].name if object_id else ""
            folder = self.store.get_or_make(stage, name, make, description, of)
            self.made[stage, object_id] = Output(name, folder)
        return self.made[stage, object_id]

    def _description(
        self, settings: dict[str, Any], upstream: dict[str, str], *parts: object
    ) -> Description:
        """What an output's name is made of.

        `parts` run to make it and to read the data it is made from: names of modules (what trains
        takes seconds to import), or objects of classes in them.
        """
        known = (part for part in parts if part is not None)
        modules = (part if isinstance(part, str) else type(part).__module__ for part in known)
        return described(settings, upstream, self.settings.seed, stage_code(*modules))
