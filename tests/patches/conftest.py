import dataclasses

import numpy as np
import pytest

from hlp.data.synthetic.objects import demo_objects
from hlp.records import Frame
from hlp.rendering.views import ViewsSettings, render_views

SETTINGS = ViewsSettings("numba", 12, "hemisphere", -10.0, 10.0, 3, 700.0, 300.0, 72)


@pytest.fixture(scope="session")
def model():
    """A demo object, not symmetric; its sizes are set so that a view holds whole windows."""
    first = next(iter(demo_objects().values()))
    return dataclasses.replace(first, holistic_size=0.10, local_size=0.04)


@pytest.fixture(scope="session")
def views(model):
    return render_views(model, SETTINGS, seed=1)


@pytest.fixture(scope="session")
def room():
    """A slanted wall seen by a camera, with a hole in its depth."""
    y, x = np.mgrid[:96, :128]
    depth = (0.8 + 0.002 * x).astype(np.float32)
    depth[20:40, 50:70] = 0.0
    rgb = np.stack([x, y, x + y], axis=-1).astype(np.uint8)
    camera = np.array([[110.0, 0.0, 63.5], [0.0, 110.0, 47.5], [0.0, 0.0, 1.0]])
    return Frame(1, 1, rgb, depth, camera)
