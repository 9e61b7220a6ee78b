"""Metric patch sizes of an object that states none (paper, Sec. 3: sizes per object).

The paper prints three sizes of each kind; both rules reproduce the printed ones.
"""

import numpy as np
from jaxtyping import Float

_HOLISTIC_FACTOR = 1.08
_HOLISTIC_LIMIT = 0.20
# Printed by the paper: Ape 3 cm, Cam 4 cm, Driller 8 cm, at LINEMOD's diameters.
_LOCAL_DIAMETERS = (0.102, 0.172, 0.261)
_LOCAL_SIZES = (0.03, 0.04, 0.08)


def holistic_size(vertices: Float[np.ndarray, "v 3"]) -> float:
    """Side (m) of the holistic patch: 1.08 times the middle extent of the bounding box.

    At most 20 cm, rounded to the centimetre. Printed: Ape 8, Driller 20, Bowl 18 cm.
    """
    middle = float(np.sort(np.ptp(vertices, axis=0))[1])
    return round(min(_HOLISTIC_FACTOR * middle, _HOLISTIC_LIMIT), 2)


def local_size(diameter: float) -> float:
    """Side (m) of the local patch: linear in the diameter between the three printed sizes.

    Constant beyond them, rounded to the millimetre.
    """
    return round(float(np.interp(diameter, _LOCAL_DIAMETERS, _LOCAL_SIZES)), 3)
