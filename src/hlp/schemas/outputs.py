"""stage.json, which HLP writes beside each output of a stage."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StrictStr


class StageRecord(BaseModel):
    """stage.json of a finished output; `files` are checksums by path, `seconds` that it took."""

    model_config = ConfigDict(extra="ignore", strict=True)

    stage: str
    fingerprint: str
    seconds: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    files: dict[StrictStr, StrictStr]
