"""What is wrong with frames, data sets, learnt objects and the machine: one module per kind."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong: its kind, where it was seen, what it is and what to do."""

    kind: str
    where: str
    problem: str
    advice: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.where}: {self.problem}. {self.advice}"
