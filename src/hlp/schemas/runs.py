"""What runs and sweeps write of themselves, as reports read it again."""

from typing import Any

from pydantic import BaseModel, ConfigDict


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
