"""Starts the task that a configuration names: run the method, or one of the studies."""

from pathlib import Path

from hlp.config.build import Run
from hlp.config.settings import BasinSettings, BenchSettings, OracleSettings, SearchSettings
from hlp.runs import runner
from hlp.studies import basin, bench, oracle, search


def run_task(run: Run, output: Path) -> None:
    """Run the task that config group `task` names. Raises what the task raises."""
    task = run.settings.task
    if isinstance(task, OracleSettings):
        oracle.run_oracle(run, task, output)
    elif isinstance(task, BasinSettings):
        basin.run_basin(run, task, output)
    elif isinstance(task, BenchSettings):
        bench.run_bench(run, task, output)
    elif isinstance(task, SearchSettings):
        search.run_search(run, task, output)
    else:
        runner.run_method(run, output)
