"""The records that HLP writes beside what it makes: stages' outputs and learnt objects."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, StrictStr

_Id = Annotated[int, Field(ge=0)]
_Length = Annotated[float, Field(gt=0, allow_inf_nan=False)]  # m


class _Record(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True)


class StageRecord(_Record):
    """stage.json of a finished output; `files` are checksums by path, `seconds` that it took."""

    stage: str
    fingerprint: str
    seconds: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    files: dict[StrictStr, StrictStr]


class Learnt(_Record):
    """learnt.json: ids by name, the classifier's classes, settings, checksums by path."""

    objects: dict[StrictStr, _Id]
    classes: list[_Id]
    settings: dict[StrictStr, Any]
    files: dict[StrictStr, StrictStr]


class LearntObject(_Record):
    """object.json of a learnt object (metres)."""

    id: _Id
    name: str
    colored: bool
    diameter: _Length
    holistic_size: _Length
    local_size: _Length


class ScoreWeights(_Record):
    """score.json of a learnt object."""

    bias: Annotated[float, Field(allow_inf_nan=False)]
    cost: Annotated[float, Field(allow_inf_nan=False)]
    shape: Annotated[float, Field(allow_inf_nan=False)]
