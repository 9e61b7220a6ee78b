"""Warm start: learning more objects from the classifier and encoder of an earlier run."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Le

from hlp.errors import ConfigError
from hlp.method.settings import MethodSettings
from hlp.settings import Count, Doc, Settings
from hlp.stages.manifest import plain
from hlp.stages.store import Output, StageStore


@dataclass(frozen=True)
class WarmStartSettings(Settings):
    """Config key `warm_start`: add objects to those of an earlier run."""

    manifest: Annotated[
        str | None,
        Doc(
            "manifest.json of an earlier run of some of these objects. Its encoder is used as it "
            "is and its classifier is trained further; null: everything is learnt from scratch"
        ),
    ] = None
    epochs: Annotated[Count, Le(10_000), Doc("epochs of the classifier's further training (D)")] = 4


@dataclass(frozen=True)
class WarmStart:
    """Classifier and encoder of an earlier run; `labels` maps its classes to those of this run."""

    classifier: Output
    encoder: Output
    labels: Mapping[int, int]
    epochs: int


def read_warm_start(
    start: WarmStartSettings, settings: MethodSettings, views: Mapping[int, str], store: StageStore
) -> WarmStart:
    """Classifier and encoder that a manifest names, from this run's `work`.

    `views` are the fingerprints of this run's views by object id; objects are the same if their
    views are (class i is the i-th object by id, 0 background). Raises MissingFileError if the
    manifest or what it names is missing, DataError if that is damaged, ConfigError if it cannot be
    the start: it has other settings, or an object that this run does not have.
    """
    manifest = Path(str(start.manifest))
    patches, shared = settings.patches, {"trainer": settings.trainer}
    needed: dict[str, dict[str, Any]] = {
        "classifier": {"holistic": patches.holistic, "classifier": settings.classifier, **shared},
        "encoder": {"local": patches.local, "encoder": settings.encoder, **shared},
    }
    outputs, records = {}, {}
    for stage, own in needed.items():
        outputs[stage] = store.named_by(manifest, stage)
        records[stage] = store.read_record(stage, outputs[stage].fingerprint)
        before = records[stage]["settings"]
        other = [key for key, value in own.items() if before.get(key) != plain(value)]
        if other:
            what = f"warm_start.manifest: the {stage} of {manifest} has other settings"
            raise ConfigError(f"{what}: {', '.join(other)}")
    labels = _labels(manifest, records["classifier"]["upstream"], views)
    return WarmStart(outputs["classifier"], outputs["encoder"], labels, start.epochs)


def _labels(
    manifest: Path, upstream: Mapping[str, str], views: Mapping[int, str]
) -> Mapping[int, int]:
    now = {name: label for label, (_, name) in enumerate(sorted(views.items()), start=1)}
    views_of = ((key.partition("views_")[2], name) for key, name in upstream.items())
    known = sorted((int(object_id), name) for object_id, name in views_of if object_id)
    gone = [object_id for object_id, name in known if name not in now]
    if gone:
        raise ConfigError(
            f"warm_start.manifest: {manifest} knows objects that this run does not "
            f"have, or has with other views: {gone}"
        )
    return {0: 0} | {label: now[name] for label, (_, name) in enumerate(known, start=1)}
