"""Stages that learn the objects: views, classifier, encoder, codebooks. Each is made once.

Torch and Lightning, which take seconds to import, are imported when a stage is made.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from hlp.codebook.entries import load_codebook, save_codebook
from hlp.data.dataset import Dataset, frames_identity
from hlp.method.find.estimator import PoseEstimator
from hlp.method.learn.checkpoints import StartingWeights, read_weights
from hlp.method.learn.model_files import load_classifier
from hlp.method.learn.progress import counting_objects
from hlp.method.learn.score_calibration import calibrate_score
from hlp.method.settings import MethodSettings
from hlp.method.stage_settings import (
    ClassifierStage,
    CodebookStage,
    EncoderStage,
    ScoreStage,
    ViewsStage,
)
from hlp.models.encoder import Encoder
from hlp.models.network import Network
from hlp.records import Codebook, ObjectModel, Views
from hlp.refinement.score_model import PRIOR, ScoreModel, load_score_model, save_score_model
from hlp.rendering.views import load_views, render_views, save_views
from hlp.source_code import Code
from hlp.stages.fingerprint import fingerprint, stage_code
from hlp.stages.manifest import device_name
from hlp.stages.store import Output, StageStore
from hlp.stages.warm_start import WarmStart, WarmStartSettings, read_warm_start

# By name, since importing them takes seconds.
_CLASSIFIER_TRAINING = "hlp.method.learn.classifier_training"
_ENCODER_TRAINING = "hlp.method.learn.encoder_training"
_CODEBOOK_BUILDING = "hlp.method.learn.codebook_building"


class TrainingStages:
    """Learns the objects from their models, or reuses what was learnt before.

    Each stage's fingerprint holds exactly the settings and inputs that its `make` uses.
    """

    def __init__(
        self,
        dataset: Dataset,
        settings: MethodSettings,
        store: StageStore,
        warm_start: WarmStartSettings | None = None,
    ) -> None:
        self.dataset = dataset
        self.settings = settings
        self.store = store
        self._warm_start_settings = warm_start
        self._made: dict[tuple[str, int], Output] = {}

    @property
    def models(self) -> Mapping[int, ObjectModel]:
        """The objects that are learnt, by id."""
        return self.dataset.models

    @property
    def classes(self) -> Sequence[int]:
        """Object id of each class of the classifier, from class 1 on; class 0 is background."""
        return sorted(self.models)

    @property
    def made(self) -> Mapping[tuple[str, int], Output]:
        """The outputs used so far, by stage and object id (0: of all objects)."""
        return dict(self._made)

    def adopt(self, made: Mapping[tuple[str, int], Output]) -> None:
        """Use outputs that another object with the same settings has made or found."""
        self._made |= made

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

        return self._stage("views", object_id, *self._views_inputs(object_id), make)

    def _views_inputs(self, object_id: int) -> tuple[Mapping[str, Any], Mapping[str, str]]:
        """Settings and upstream of an object's views."""
        upstream = {"mesh": self.dataset.mesh_identities[object_id]}
        return ViewsStage.of(self.settings).named(), upstream

    def missing_views(self) -> list[int]:
        """Objects whose views are not on disk."""
        names = {i: self._name("views", *self._views_inputs(i)) for i in self.models}
        return [i for i, name in names.items() if not self.store.holds("views", name)]

    def take_views(self, object_id: int) -> None:
        """Use views that a worker of this run has just written."""
        name = self._name("views", *self._views_inputs(object_id))
        folder = self.store.take("views", name, self.models[object_id].name, reused=False)
        self._made["views", object_id] = Output(name, folder)

    def load_views(self, object_id: int) -> Views:
        """Views of one object, from disk."""
        return load_views(self.views(object_id).folder, object_id)

    def classifier(self) -> Output:
        """Stage 1: the holistic classifier of all objects."""
        stage = ClassifierStage.of(self.settings)
        upstream = {f"views_{i}": self.views(i).fingerprint for i in self.models}
        upstream["photographs"] = self.dataset.photographs_identity
        upstream["background_frames"] = frames_identity(self.dataset.background_frames)
        settings = {
            **stage.named(),
            "device": device_name(stage.trainer.accelerator),
            "sizes": {str(i): m.holistic_size for i, m in sorted(self.models.items())},
        }
        start = None
        if self._warm_start is not None:
            epochs = self._warm_start_settings.epochs if self._warm_start_settings else 0
            settings["warm_start"] = {"epochs": epochs}
            upstream["warm_start"] = self._warm_start.classifier.fingerprint
            weights = read_weights(self._warm_start.classifier.folder)
            start = StartingWeights(weights, self._warm_start.labels, epochs)

        def make(folder: Path) -> None:
            from hlp.method.learn.classifier_training import train_classifier

            views_of = counting_objects(self.load_views, "windows cut", len(self.models))
            train_classifier(self.models, views_of, self.dataset, stage, folder, start)

        return self._stage("classifier", 0, settings, upstream, make)

    @cached_property
    def _warm_start(self) -> WarmStart | None:
        """What training starts from; None if everything is learnt from scratch."""
        given = self._warm_start_settings
        if given is None or given.manifest is None:
            return None
        views = {i: self.views(i).fingerprint for i in self.models}
        return read_warm_start(Path(given.manifest), self.settings, views, self.store)

    def load_classifier(self) -> Network:
        """The trained classifier, from disk; class i is the i-th object by id, 0 background."""
        return load_classifier(self.classifier().folder, self.settings.machine)

    def encoder(self) -> Output:
        """Stage 2: the encoder of local patches, shared by all objects."""
        if self._warm_start is not None and ("encoder", 0) not in self._made:
            kept = self._warm_start.encoder
            self.store.take("encoder", kept.fingerprint, "", reused=True)
            self._made["encoder", 0] = kept
        if ("encoder", 0) in self._made:
            return self._made["encoder", 0]
        stage = EncoderStage.of(self.settings)
        settings = {
            **stage.named(),
            "device": device_name(stage.trainer.accelerator),
            "sizes": {str(i): m.local_size for i, m in sorted(self.models.items())},
        }
        if stage.encoder.needs_frames:
            upstream = {
                "encoder_frames": frames_identity(self.dataset.encoder_frames),
                "background_frames": frames_identity(self.dataset.background_frames),
            }
        else:
            upstream = {f"views_{i}": self.views(i).fingerprint for i in self.models}

        def make(folder: Path) -> None:
            from hlp.method.learn.encoder_training import train_encoder

            views_of = counting_objects(self.load_views, "pairs cut", len(self.models))
            train_encoder(self.models, views_of, self.dataset, stage, folder)

        return self._stage("encoder", 0, settings, upstream, make)

    def load_encoder(self) -> Encoder:
        """The trained encoder, from disk."""
        machine = self.settings.machine
        return self.settings.encoder.load(self.encoder().folder, machine.threads, machine.device)

    def codebook(self, object_id: int) -> Output:
        """Stage 2: the codebook of one object."""
        stage = CodebookStage.of(self.settings)
        settings = {
            **stage.named(),
            "size": self.models[object_id].local_size,
            "object_id": object_id,
            "device": device_name(self.settings.machine.device),
        }
        upstream = {
            "views": self.views(object_id).fingerprint,
            "encoder": self.encoder().fingerprint,
        }

        def make(folder: Path) -> None:
            from hlp.method.learn.codebook_building import build_codebook

            views, model = self.load_views(object_id), self.models[object_id]
            made = build_codebook(model, views, self.load_encoder(), stage)
            save_codebook(folder, made)

        return self._stage("codebook", object_id, settings, upstream, make)

    def score(self, object_id: int) -> Output:
        """The score of one object's poses, calibrated on rendered scenes."""
        stage, model = ScoreStage.of(self.settings), self.models[object_id]
        settings = {
            **stage.named(),
            "sizes": [model.holistic_size, model.local_size],
            "device": device_name(stage.find.machine.device),
        }
        upstream = {
            "model": self.dataset.model_identities[object_id],
            "classifier": self.classifier().fingerprint,
            "encoder": self.encoder().fingerprint,
            "codebook": self.codebook(object_id).fingerprint,
            "background_frames": frames_identity(self.dataset.background_frames),
        }

        def make(folder: Path) -> None:
            estimator = PoseEstimator(self, stage.find, (object_id,))
            frames = self.dataset.load_background_frames()
            scenes, rendering = stage.score.scenes, stage.rendering
            save_score_model(
                folder, calibrate_score(estimator, object_id, frames, scenes, rendering)
            )

        return self._stage("score", object_id, settings, upstream, make)

    def load_score_model(self, object_id: int) -> ScoreModel:
        """The score of one object's poses, from disk."""
        if self.settings.score.scenes == 0:
            return PRIOR
        return load_score_model(self.score(object_id).folder)

    def search_folder(self, object_ids: Sequence[int]) -> None:
        """None: a codebook's fingerprint excludes the search's settings, so none is stored."""

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
            of = self.models[object_id].name if object_id else ""
            folder = self.store.get_or_make(stage, name, make, described, of)
            self._made[stage, object_id] = Output(name, folder)
        return self._made[stage, object_id]

    def _name(self, stage: str, settings: Mapping[str, Any], upstream: Mapping[str, str]) -> str:
        return fingerprint(stage, self._code(stage), self.settings.seed, settings, upstream)

    def _code(self, stage: str) -> Code:
        """The code that makes a stage's output, and that reads the data it is made from."""
        dataset = self.dataset
        modules = {
            "views": [render_views.__module__],
            "classifier": [
                _CLASSIFIER_TRAINING,
                type(dataset).__module__,
                type(dataset.background_frames).__module__,
            ],
            "encoder": [_ENCODER_TRAINING, type(self.settings.encoder).__module__],
            "codebook": [
                _CODEBOOK_BUILDING,
                save_codebook.__module__,
                type(self.settings.encoder).__module__,
            ],
            "score": [
                calibrate_score.__module__,
                save_score_model.__module__,
                type(self.settings.encoder).__module__,
                type(self.settings.codebook).__module__,
                type(self.settings.voting).__module__,
                type(self.settings.refinement).__module__,
                type(dataset.background_frames).__module__,
            ],
        }
        if self.settings.encoder.needs_frames:
            readers = (dataset, dataset.encoder_frames, dataset.background_frames)
            modules["encoder"] += [type(each).__module__ for each in readers]
        own = [name for name in modules[stage] if name != type(None).__module__]
        return stage_code(*own)
