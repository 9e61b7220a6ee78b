"""stage.json, which HLP writes beside each output of a stage."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, StrictStr


class StageRecord(BaseModel):
    """stage.json of a finished output; `files` are checksums by path, `seconds` that it took."""

    model_config = ConfigDict(extra="ignore", strict=True)

    stage: str
    fingerprint: str
    seconds: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    files: dict[StrictStr, StrictStr]


class _Record(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True)


class ManifestData(_Record):
    """The part of a manifest that names the frames; `frames` is the hash of their content."""

    keys: list[str]
    frames: str = ""


class Manifest(_Record):
    """manifest.json of a run."""

    config: dict[str, Any]
    data: ManifestData


class Sweep(_Record):
    """sweep.json."""

    overrides: list[str]
    swept: list[str]
    defaults: dict[str, Any] = {}
