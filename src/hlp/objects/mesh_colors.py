"""Colours and textures of mesh files, as trimesh reads them."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import UInt8

from hlp.errors import DataError
from hlp.records import Texture

if TYPE_CHECKING:
    import trimesh
    from trimesh.resolvers import FilePathResolver

PLAIN_COLOR = (210, 210, 210)
"""Colour of meshes whose files state none."""
_NO_IMAGES = (".mtl", ".bin")  # files that a mesh names: an OBJ's materials, a glTF's numbers
_MOST_REPEATS = 1e6  # of a texture; beyond, coordinates are no numbers of texels
_logger = logging.getLogger(__name__)


Colors = UInt8[np.ndarray, "v 3"]


def plain_colors(raw: trimesh.Trimesh) -> tuple[Colors, None, bool]:
    """What `mesh_colors` returns for a file that states no colour."""
    return np.tile(np.array(PLAIN_COLOR, np.uint8), (len(raw.vertices), 1)), None, False


def mesh_colors(path: Path, raw: trimesh.Trimesh) -> tuple[Colors, Texture | None, bool]:
    """Colours of the vertices, the texture if there is one, and whether the file states any colour.

    A texture whose image cannot be read is logged as a warning, and counts as none.
    """
    visual: Any = raw.visual
    if visual is None or not visual.defined:
        return plain_colors(raw)
    if visual.kind == "texture":
        return _textured(path, raw)
    colors = np.asarray(visual.vertex_colors, dtype=np.uint8)
    if len(colors) != len(raw.vertices):
        return plain_colors(raw)
    return colors[:, :3].copy(), None, True


def _textured(path: Path, raw: trimesh.Trimesh) -> tuple[Colors, Texture | None, bool]:
    """Like `mesh_colors`, for a mesh with a material."""
    visual: Any = raw.visual
    material = visual.material
    picture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    uv = visual.uv
    if picture is None or uv is None or len(uv) != len(raw.vertices):
        # A material of one colour.
        color = np.asarray(material.main_color, dtype=np.uint8)[:3]
        return np.tile(color, (len(raw.vertices), 1)), None, True
    try:
        image = np.asarray(picture.convert("RGB"), dtype=np.uint8)
    except (OSError, ValueError, SyntaxError) as error:  # what Pillow raises for damaged images
        _logger.warning("%s: its texture cannot be read (%s): the object is grey", path, error)
        return plain_colors(raw)
    coordinates = np.nan_to_num(np.array(uv, dtype=np.float64))
    if np.abs(coordinates).max() > _MOST_REPEATS:
        raise DataError(f"{path} has texture coordinates beyond {_MOST_REPEATS:g}: export it again")
    height, width = image.shape[:2]
    column = np.floor(coordinates[:, 0] * width).astype(np.int64) % width
    row = np.floor((1.0 - coordinates[:, 1]) * height).astype(np.int64) % height
    colors = np.asarray(image[row, column])
    if np.ptp(image, axis=(0, 1)).max() == 0:  # also what trimesh puts where no image is named
        return colors, None, True
    return colors, Texture(image.copy(), coordinates), True


def with_one_kind_of_color(scene: trimesh.Scene) -> trimesh.Scene:
    """The scene with colours that survive joining its parts into one mesh.

    Joined with parts coloured in another way, a texture would be lost: then every part gets colours
    of its vertices.
    """
    import trimesh

    parts: list[Any] = [p for p in scene.geometry.values() if isinstance(p, trimesh.Trimesh)]
    if len({part.visual.kind for part in parts}) > 1:
        for part in parts:
            if part.visual.kind == "texture":
                part.visual = part.visual.to_color()
    return scene


def files_beside(path: Path, missing: list[str]) -> FilePathResolver:
    """What trimesh reads files by that a mesh names; images that it cannot read go to `missing`.

    It reads nothing from outside of the mesh's folder.
    """
    from trimesh.resolvers import FilePathResolver

    class Noting(FilePathResolver):
        def get(self, name: str) -> Any:
            try:
                for said in (name.strip(), unquote(name.strip())):
                    if (file := path.parent / said).exists() and not file.is_file():
                        raise FileNotFoundError(f"{file} is no file")  # a pipe is read for ever
                return super().get(name)
            except Exception:
                if not name.strip().lower().endswith(_NO_IMAGES):
                    missing.append(unquote(name.strip()))
                raise

    return Noting(str(path))


SMALL = 0.035  # m: a mesh that seems to be smaller may be in centimetres
_SMALLEST, _LARGEST = 0.01, 2.0  # m: diameters of objects that can be found
_UNITS = ((1.0, "metres"), (0.001, "millimetres"))


def guess_scale(path: Path, diameter: float) -> float:
    """Metres per unit of a mesh file whose largest distance between vertices is `diameter` units.

    Files are taken for metres, in which glTF is by its specification, or else for millimetres,
    whichever makes the object 1 cm to 2 m large. The guess is logged, with a warning where the
    object is so small that the file may be in centimetres. Raises DataError if neither does.
    """
    likely = (unit for unit in _UNITS if _SMALLEST <= diameter * unit[0] <= _LARGEST)
    scale, name = next(likely, (0.0, ""))
    if not name:
        raise DataError(
            f"{path} is {diameter:.4g} units large, a likely size neither in metres nor in "
            "millimetres: give mesh_scale, in metres per unit (0.01 for centimetres)"
        )
    _logger.info(
        "%s: %.4g units large, taken for %s (mesh_scale=%g; give another one if this is wrong)",
        *(path.name, diameter, name, scale),
    )
    if diameter * scale < SMALL:
        _logger.warning(
            "%s: warning: an object of %.0f mm; if it is %.0f mm large in truth, the mesh is in "
            "centimetres: give mesh_scale=0.01",
            *(path.name, diameter * scale * 1000.0, diameter * 10.0),
        )
    return scale


def check_scale(path: Path, diameter: float, scale: float) -> None:
    """Raise DataError if a mesh of `diameter` units would have a size that no object has."""
    if not _SMALLEST <= diameter * scale <= _LARGEST:
        raise DataError(
            f"{path}: diameter {diameter * scale:.4g} m at {scale:g} m per unit is not within "
            f"{_SMALLEST} … {_LARGEST} m: probably the wrong unit (mesh_scale: metres need 1, "
            "millimetres 0.001)"
        )
