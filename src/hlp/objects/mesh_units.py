"""The unit of a mesh file: guessed from the object's size, and checked."""

import logging
from pathlib import Path

from hlp.errors import DataError

SMALL = 0.035  # m: a mesh that seems to be smaller may be in centimetres
_SIZES = (0.01, 2.0)  # m: diameters of objects that can be found
_UNITS = ((1.0, "metres"), (0.001, "millimetres"))
_IN_METRES = (".glb", ".gltf")
_logger = logging.getLogger(__name__)


def guess_scale(path: Path, diameter: float) -> float:
    """Metres per unit of a mesh file whose largest distance between vertices is `diameter` units.

    glTF is in metres by its specification. Other files are taken for metres or millimetres,
    whichever makes the object 1 cm to 2 m large. The guess is logged, as a warning if it makes the
    object so small that the file may be in centimetres. Raises DataError if neither does.
    """
    possible = [(scale, name) for scale, name in _UNITS if _is_possible(diameter * scale)]
    if not possible:
        raise DataError(
            f"{path} is {diameter:.4g} units large, a likely size neither in metres nor in "
            "millimetres: give mesh_scale, in metres per unit (0.01 for centimetres)"
        )
    scale, name = possible[0]
    say = _logger.info
    if path.suffix.lower() in _IN_METRES and scale != 1.0:
        say = _logger.warning
    say(
        "%s: %.4g units large, taken for %s (mesh_scale=%g; give another one if this is wrong)",
        path.name,
        diameter,
        name,
        scale,
    )
    if diameter * scale < SMALL:
        _logger.warning(
            "%s: warning: an object of %.0f mm; if it is %.0f mm large in truth, the mesh is in "
            "centimetres: give mesh_scale=0.01",
            path.name,
            diameter * scale * 1000.0,
            diameter * 10.0,
        )
    return scale


def check_scale(path: Path, diameter: float, scale: float) -> None:
    """Raise DataError if a mesh of `diameter` units would have a size that no object has."""
    if not _is_possible(diameter * scale):
        low, high = _SIZES
        raise DataError(
            f"{path}: diameter {diameter * scale:.4g} m at {scale:g} m per unit is not within "
            f"{low} … {high} m: probably the wrong unit (mesh_scale: metres need 1, millimetres "
            "0.001)"
        )


def _is_possible(metres: float) -> bool:
    low, high = _SIZES
    return low <= metres <= high
