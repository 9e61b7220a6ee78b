"""Tables as people and programs read them."""

import csv
import re
from pathlib import Path


def unpadded(text: str) -> str:
    """The text with every run of spaces as one, for comparing tables without their padding."""
    return re.sub(r" +", " ", text)


def csv_rows(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file by column."""
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))
