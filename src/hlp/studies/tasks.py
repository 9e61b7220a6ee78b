"""Does what config group `task` names: the method itself, or a study of it."""

from pathlib import Path

from hlp.config.build import Run


def run_task(run: Run, output: Path) -> None:
    """Do the task of a run's settings; raises what the task raises."""
    run.settings.task.run(run, output)
