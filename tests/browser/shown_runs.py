"""The runs that the browser tests look at."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ShownRuns:
    """A run and a sweep with their database; values, names and ADD(-S) recalls of its arms."""

    work: Path
    run: Path
    sweep: Path
    values: tuple[str, ...]
    names: tuple[str, ...]
    recalls: tuple[float, ...]
    key: str
