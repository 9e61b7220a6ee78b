"""What compiles kernels for a wheel; integration/test_detection_set.py builds and uses one."""

import importlib.util
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8
from numba import typeof

from wheel_folder import CHECKOUT

spec = importlib.util.spec_from_file_location("hatch_kernels", CHECKOUT / "hatch_kernels.py")
hatch_kernels = importlib.util.module_from_spec(spec)
spec.loader.exec_module(hatch_kernels)


class Pair(NamedTuple):
    image: UInt8[np.ndarray, "h w"]
    step: np.float32


def test_each_annotation_has_the_type_of_its_values_in_numba():
    values = {
        float: 1.0,
        int: 1,
        bool: True,
        np.float32: np.float32(1),
        tuple[float, int]: (1.0, 1),
        Float[np.ndarray, "n 3"]: np.zeros((2, 3)),
        Pair: Pair(np.zeros((2, 3), np.uint8), np.float32(1)),
    }
    for hint, value in values.items():
        assert hatch_kernels.numba_type(hint) == typeof(value), hint


def test_all_kernels_are_found_each_by_a_name_of_its_own():
    kernels = hatch_kernels.find_kernels()
    symbols = [kernel.symbol for kernel in kernels]
    assert {"hlp_refinement_cost_kernel_sum_costs", "hlp_image_edges__thin"} <= {*symbols}
    assert len({*symbols}) == len(symbols) >= 25
