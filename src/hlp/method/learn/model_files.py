"""What is learnt of an object and of all as files: models, networks' weights, histories."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from jaxtyping import Float

from hlp.errors import DataError
from hlp.files import read_csv, read_npz, write_json
from hlp.method.settings import MachineSettings
from hlp.models.network import Network, load_network
from hlp.records import ColorGrid, Mesh, ObjectModel, Texture
from hlp.rendering.surface import color_grid
from hlp.settings import Positive, Stored, WholeNumber, read_as

if TYPE_CHECKING:
    from torch import Tensor

CLASSIFIER = "classifier"
"""Stem of the classifier's files."""
HISTORY, WEIGHTS = "history.csv", "weights.safetensors"
_OBJECT, _MODEL = "object.json", "model.npz"
_COLORS, _TEXTURE = "colors.npz", "texture.png"
_MESH_FIELDS = ("vertices", "faces", "colors", "normals")


@dataclass(frozen=True)
class _LearntObject(Stored):
    """What `object.json` must say (metres)."""

    id: WholeNumber
    name: str
    colored: bool
    diameter: Positive
    holistic_size: Positive
    local_size: Positive


def write_model(folder: Path, model: ObjectModel) -> None:
    """Write an object's model into `folder`, which is made if missing."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {
        f"{part}_{field}": getattr(mesh, field)
        for part, mesh in (("mesh", model.mesh), ("proxy", model.proxy))
        for field in _MESH_FIELDS
    }
    arrays |= {"symmetries": model.symmetries, "near_symmetries": model.near_symmetries}
    if (texture := model.mesh.texture) is not None:
        arrays["mesh_uv"] = texture.uv
        _, encoded = cv2.imencode(".png", texture.image[..., ::-1])
        (folder / _TEXTURE).write_bytes(encoded.tobytes())
    np.savez(folder / _MODEL, **arrays)
    if model.mesh.colored:
        grid = color_grid(model.mesh)
        cells: dict[str, Any] = {"colors": grid.colors, "corner": grid.corner, "cell": grid.cell}
        np.savez_compressed(folder / _COLORS, **cells)
    sizes = model.diameter, model.holistic_size, model.local_size
    stated = _LearntObject(model.object_id, model.name, model.mesh.colored, *sizes)
    write_json(folder / _OBJECT, asdict(stated))


def read_model(folder: Path) -> ObjectModel:
    """Read what `write_model` wrote. Raises MissingFileError, DataError naming a damaged file."""
    stated = read_as(folder / _OBJECT, _LearntObject)
    stored: dict[str, Any] = read_npz(folder / _MODEL)
    try:
        parts = [{n: stored[f"{part}_{n}"] for n in _MESH_FIELDS} for part in ("mesh", "proxy")]
        mesh, proxy = (Mesh(**arrays, colored=stated.colored) for arrays in parts)
        if "mesh_uv" in stored:
            mesh = replace(mesh, texture=_read_texture(folder / _TEXTURE, stored["mesh_uv"]))
        if (folder / _COLORS).is_file():  # no grey object has it
            cells = read_npz(folder / _COLORS)
            grid = ColorGrid(cells["colors"], cells["corner"], float(cells["cell"]))
            mesh = replace(mesh, color_grid=grid)
        return ObjectModel(
            stated.id, stated.name, mesh, proxy, stated.diameter, stored["symmetries"],
            stated.holistic_size, stated.local_size, stored["near_symmetries"],
        )  # fmt: skip
    except DataError:  # it names the file
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{folder} is damaged ({error}): learn the object again") from error


def _read_texture(path: Path, uv: Float[np.ndarray, "v 2"]) -> Texture:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise DataError(f"{path} is missing or damaged: learn the object again, or copy it anew")
    return Texture(np.ascontiguousarray(image[..., ::-1]), uv)


def load_classifier(folder: Path, machine: MachineSettings) -> Network:
    """The classifier that `train_classifier` wrote into `folder`."""
    return load_network(folder / CLASSIFIER, machine.threads, machine.device)


@dataclass(frozen=True)
class StartingWeights:
    """A classifier of fewer objects to start from: its weights, and the new labels of its classes.

    It is trained further for `epochs`.
    """

    weights: Mapping[str, "Tensor"]
    labels: Mapping[int, int]
    epochs: int


def read_weights(folder: Path) -> dict[str, "Tensor"]:
    """A network's weights by name. Raises FileNotFoundError if there are none."""
    from safetensors.torch import load_file  # takes as long to import as torch

    return load_file(folder / WEIGHTS)


def read_history(folder: Path) -> list[dict[str, float]]:
    """Metrics of every epoch, in order; empty if nothing was trained. Raises DataError."""
    path = folder / HISTORY
    if not path.exists():
        return []
    history = []
    for line, row in enumerate(read_csv(path, ["epoch"], more=True), start=2):
        try:
            history.append({name: float(value) for name, value in row.items()})
        except ValueError as error:
            raise DataError(f"{path}, line {line}: no metrics of an epoch ({error})") from error
    return history
