"""What is to be done with a configuration: run the method, measure its stages, search."""

from pathlib import Path

from hlp.pipeline import basin, bench, oracle, runner, search
from hlp.pipeline.build import Run
from hlp.pipeline.settings import BasinSettings, BenchSettings, OracleSettings, SearchSettings


def run_task(planned: Run, output: Path) -> None:
    """Do what config group `task` names; raises what the task raises."""
    task = planned.settings.task
    if isinstance(task, OracleSettings):
        oracle.run(planned, task, output)
    elif isinstance(task, BasinSettings):
        basin.run(planned, task, output)
    elif isinstance(task, BenchSettings):
        bench.run(planned, task, output)
    elif isinstance(task, SearchSettings):
        search.run(planned, task, output)
    else:
        runner.run(planned, output)
