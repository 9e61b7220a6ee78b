"""What an earlier run learnt of fewer objects, to go on from when some are added."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hlp.files import read_json
from hlp.method.settings import MethodSettings
from hlp.stages.fingerprint import plain, result_settings
from hlp.stages.manifest import read_manifest
from hlp.stages.store import RECORD, Output, StageStore


@dataclass(frozen=True)
class WarmStartSettings:
    """Config key `warm_start`: what an earlier run learnt is kept, and objects are added.

    `manifest` is that run's manifest.json (None: everything is learnt from nothing). Its encoder is
    used as it is; its classifier is trained for `epochs` more.
    """

    manifest: str | None
    epochs: int


@dataclass(frozen=True)
class WarmStart:
    """Classifier and encoder of an earlier run; `labels` gives each of its classes' class now."""

    classifier: Output
    encoder: Output
    labels: Mapping[int, int]


def read_warm_start(
    manifest: Path, settings: MethodSettings, views: Mapping[int, str], store: StageStore
) -> WarmStart:
    """What the run of a manifest learnt, from this run's `work`.

    `views` are the fingerprints of this run's views by object, which tell its objects from others
    (class i is the i-th object by id, 0 background). Raises FileNotFoundError where the manifest or
    what it names is missing, ValueError where that cannot be gone on from: other settings, or an
    object that this run has not.
    """
    patches = settings.patches
    made = {each["stage"]: each["fingerprint"] for each in read_manifest(manifest)["stages"]}
    shared = {"trainer": settings.trainer}
    wanted: dict[str, dict[str, Any]] = {
        "classifier": {"holistic": patches.holistic, "classifier": settings.classifier, **shared},
        "encoder": {"local": patches.local, "encoder": settings.encoder, **shared},
    }
    found = {}
    for stage, own in wanted.items():
        folder = store.root / stage / str(made.get(stage))
        if not (folder / RECORD).is_file():
            raise FileNotFoundError(
                f"warm_start.manifest: {store.root} has no {stage} of {manifest}"
            )
        record = read_json(folder / RECORD)
        _check_same(f"{stage} of {manifest}", record["settings"], own)
        found[stage] = Output(folder.name, folder), record["upstream"]
    (classifier, upstream), (encoder, _) = found["classifier"], found["encoder"]
    return WarmStart(classifier, encoder, _labels(manifest, upstream, views))


def _check_same(of: str, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
    other = [key for key, value in now.items() if before[key] != plain(result_settings(value))]
    if other:
        raise ValueError(f"warm_start.manifest: the {of} has other settings: {', '.join(other)}")


def _labels(
    manifest: Path, upstream: Mapping[str, str], views: Mapping[int, str]
) -> Mapping[int, int]:
    now = {name: label for label, (_, name) in enumerate(sorted(views.items()), start=1)}
    before = sorted(
        (int(key.removeprefix("views_")), name)
        for key, name in upstream.items()
        if key.startswith("views_")
    )
    gone = [object_id for object_id, name in before if name not in now]
    if gone:
        raise ValueError(
            f"warm_start.manifest: {manifest} knows objects that this run has not, "
            f"or has with other views: {gone}"
        )
    return {0: 0} | {label: now[name] for label, (_, name) in enumerate(before, start=1)}
