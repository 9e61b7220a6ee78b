"""An object's model as files: meshes, colours, symmetries, sizes."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from annotated_types import Ge, Gt
from jaxtyping import Float

from hlp.errors import DataError, MissingFileError
from hlp.files import read_json, read_npz, write_json
from hlp.method.settings import MachineSettings
from hlp.models.network import Network, load_network
from hlp.records import ColorGrid, Mesh, ObjectModel, Texture
from hlp.rendering.color_grid import color_grid
from hlp.settings import Settings, stored_as

_OBJECT, _MODEL = "object.json", "model.npz"
_COLORS, _TEXTURE = "colors.npz", "texture.png"
_MESH_FIELDS = ("vertices", "faces", "colors", "normals")


@dataclass(frozen=True)
class _LearntObject(Settings):
    """What `object.json` must say (metres)."""

    id: Annotated[int, Ge(0)]
    name: str
    colored: bool
    diameter: Annotated[float, Gt(0)]
    holistic_size: Annotated[float, Gt(0)]
    local_size: Annotated[float, Gt(0)]


def write_model(folder: Path, model: ObjectModel) -> None:
    """Write an object's model into `folder`, which is made if missing."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {
        f"{part}_{field}": getattr(mesh, field)
        for part, mesh in (("mesh", model.mesh), ("proxy", model.proxy))
        for field in _MESH_FIELDS
    }
    arrays |= {"symmetries": model.symmetries, "siblings": model.siblings}
    texture = model.mesh.texture
    if texture is not None:
        arrays["mesh_uv"] = texture.uv
        _, encoded = cv2.imencode(".png", texture.image[..., ::-1])
        (folder / _TEXTURE).write_bytes(encoded.tobytes())
    np.savez(folder / _MODEL, **arrays)
    if model.mesh.colored:
        grid = color_grid(model.mesh)
        np.savez_compressed(
            folder / _COLORS, colors=grid.colors, corner=grid.corner, cell=grid.cell
        )
    content = {
        "id": model.object_id,
        "name": model.name,
        "colored": model.mesh.colored,
        "diameter": model.diameter,
        "holistic_size": model.holistic_size,
        "local_size": model.local_size,
    }
    write_json(folder / _OBJECT, content)


def read_model(folder: Path) -> ObjectModel:
    """Read what `write_model` wrote. Raises MissingFileError, DataError naming a damaged file."""
    for name in (_OBJECT, _MODEL):
        if not (folder / name).is_file():
            raise MissingFileError(f"{folder} is no learnt object: it has no {name}")
    stated = stored_as(_LearntObject, read_json(folder / _OBJECT), str(folder / _OBJECT))
    stored = read_npz(folder / _MODEL)
    try:
        texture = _read_texture(folder, stored["mesh_uv"]) if "mesh_uv" in stored else None
        looks = {"mesh": (texture, _read_colors(folder)), "proxy": (None, None)}
        mesh, proxy = (
            Mesh(
                **{field: stored[f"{part}_{field}"] for field in _MESH_FIELDS},
                texture=image,
                colored=stated.colored,
                color_grid=grid,
            )
            for part, (image, grid) in looks.items()
        )
        return ObjectModel(
            stated.id,
            stated.name,
            mesh,
            proxy,
            stated.diameter,
            stored["symmetries"],
            stated.holistic_size,
            stated.local_size,
            stored["siblings"],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f"{folder} is damaged ({error}): learn the object again") from error


def _read_colors(folder: Path) -> ColorGrid | None:
    """None for a grey object, and for one that was learnt before this file was written."""
    path = folder / _COLORS
    if not path.is_file():
        return None
    stored = read_npz(path)
    return ColorGrid(stored["colors"], stored["corner"], float(stored["cell"]))


def _read_texture(folder: Path, uv: Float[np.ndarray, "v 2"]) -> Texture:
    image = cv2.imread(str(folder / _TEXTURE), cv2.IMREAD_COLOR)
    if image is None:
        raise DataError(
            f"{folder / _TEXTURE} is missing or damaged: learn the object again, or copy it anew"
        )
    return Texture(np.ascontiguousarray(image[..., ::-1]), uv)


CLASSIFIER = "classifier"


def load_classifier(folder: Path, machine: MachineSettings) -> Network:
    """The classifier that `train_classifier` wrote into `folder`."""
    return load_network(folder / CLASSIFIER, machine.threads, machine.device)
