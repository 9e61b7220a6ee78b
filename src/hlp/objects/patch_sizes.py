"""Metric patch sizes for objects whose settings state none.

The paper (section 3) gives three sizes of each kind; both rules reproduce them.
"""

import numpy as np
from jaxtyping import Float

_HOLISTIC_FACTOR = 1.08
_HOLISTIC_LIMIT = 0.20
# From the paper: Ape 3 cm, Cam 4 cm, Driller 8 cm, with LINEMOD's diameters (m).
_LOCAL_DIAMETERS = (0.102, 0.172, 0.261)
_LOCAL_SIZES = (0.03, 0.04, 0.08)


def holistic_size(vertices: Float[np.ndarray, "v 3"]) -> float:
    """Side (m) of the holistic patch: 1.08 times the middle extent of the bounding box.

    At most 20 cm, rounded to the centimetre. In the paper: Ape 8, Driller 20, Bowl 18 cm.
    """
    middle = float(np.sort(np.ptp(vertices, axis=0))[1])
    return round(min(_HOLISTIC_FACTOR * middle, _HOLISTIC_LIMIT), 2)


def local_size(diameter: float) -> float:
    """Side (m) of the local patch: linear in the diameter (m) between the paper's three sizes.

    Constant beyond them, rounded to the millimetre.
    """
    return round(float(np.interp(diameter, _LOCAL_DIAMETERS, _LOCAL_SIZES)), 3)
