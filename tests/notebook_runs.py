"""The project's notebooks, run from first cell to last with other values; what they show."""

import base64
from pathlib import Path

import cv2
import nbformat
import numpy as np
from nbclient import NotebookClient
from nbformat import NotebookNode


def execute(path: Path, parameters: str) -> NotebookNode:
    """Run a notebook in its folder, with other values in its parameters cell."""
    notebook = nbformat.read(path, as_version=4)
    (cell,) = [cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", [])]
    assert {line.split(" = ")[0] for line in cell.source.splitlines()} == {
        line.split(" = ")[0] for line in parameters.splitlines()
    }
    cell.source = parameters
    resources = {"metadata": {"path": str(path.parent)}}
    client = NotebookClient(notebook, timeout=600, resources=resources)
    return client.execute()


def pictures(notebook: NotebookNode) -> list[np.ndarray]:
    found = []
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            data = output.get("data", {}).get("image/png") or output.get("data", {}).get(
                "image/jpeg"
            )
            if data is not None:
                buffer = np.frombuffer(base64.b64decode(data), np.uint8)
                picture = cv2.imdecode(buffer, cv2.IMREAD_COLOR)
                assert picture is not None
                found.append(picture)
    return found


def printed(notebook: NotebookNode) -> str:
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    texts = [output.get("text", "") for output in outputs]
    shown = [output.get("data", {}).get("text/markdown", "") for output in outputs]
    return "\n".join([*texts, *shown])
