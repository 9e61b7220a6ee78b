"""The notebooks as they are committed. integration/test_wheel.py runs them."""

import re
from pathlib import Path

import nbformat
import pytest

NOTEBOOKS = Path(__file__).parents[2] / "notebooks"


LARGEST = 900_000  # bytes


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_outputs_are_small_and_of_one_run_or_none(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    counts = [cell.execution_count for cell in cells]
    assert counts in ([None] * len(cells), [*range(1, len(cells) + 1)])
    kinds = {output.output_type for cell in cells for output in cell.outputs}
    assert kinds <= {"stream", "display_data", "execute_result"} and (kinds == set() or counts[0])
    assert not re.search(r"(?<![.\w])/(home|root|tmp|work)/", path.read_text())
    assert path.stat().st_size < LARGEST
