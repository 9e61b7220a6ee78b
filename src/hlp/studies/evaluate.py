"""The task of a plain run: learn, find and score."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from hlp.config.settings import TASKS
from hlp.settings import Settings

if TYPE_CHECKING:
    from hlp.config.build import Run


@TASKS.register
@dataclass(frozen=True)
class EvaluateSettings(Settings):
    """Config group `task`: learn, find and score, what `hlp run` is for."""

    name: Literal["evaluate"] = "evaluate"

    def run(self, run: Run, output: Path) -> None:
        """See `run_method`."""
        from hlp.runs import runner

        runner.run_method(run, output)
