"""The JSON files that HLP writes beside its outputs, as far as it reads them again."""

from dataclasses import dataclass, field
from typing import Annotated, Any

from annotated_types import Ge, Le

from hlp.settings import Stored


@dataclass(frozen=True)
class StageRecord(Stored):
    """stage.json of a finished output; `files` are checksums by path, `seconds` that it took."""

    stage: str
    fingerprint: str
    seconds: Annotated[float, Ge(0), Le(1e9)]
    files: dict[str, str]


@dataclass(frozen=True)
class ManifestData(Stored):
    """The part of a manifest that names the frames; `frames` is the hash of their content."""

    keys: list[str]
    frames: str = ""


@dataclass(frozen=True)
class Manifest(Stored):
    """manifest.json of a run."""

    config: dict[str, Any]
    data: ManifestData


@dataclass(frozen=True)
class Sweep(Stored):
    """sweep.json."""

    overrides: list[str]
    swept: list[str]
    defaults: dict[str, Any] = field(default_factory=dict)
