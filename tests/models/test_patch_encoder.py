import pytest
import torch

from hlp.models.encoder_training import PatchEncoder


@pytest.mark.parametrize(
    ("widths", "dimension"), [((8, 12, 16), 24), ((4,), 10), ((32, 64, 96, 128), 200)]
)
def test_shapes_and_parameter_counts(widths, dimension):
    network = PatchEncoder(widths, dimension)
    assert network(torch.zeros(3, 4, 32, 32)).shape == (3, dimension)
    expected, previous, side = 0, 4, 32
    for width in widths:
        expected += 9 * previous * width + width + 2 * width  # convolution, bias, batch norm
        previous, side = width, side // 2
    expected += previous * side**2 * dimension + dimension
    assert sum(parameter.numel() for parameter in network.parameters()) == expected
