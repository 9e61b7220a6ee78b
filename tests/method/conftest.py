"""A frame, and learnt objects to change, for the tests of the detector."""

import shutil
from pathlib import Path

import pytest

from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from tiny_method import MODELS

SMALL = {"scenes": 12, "width": 320, "height": 240, "objects": (5, 5), "clutter": (1, 3)}
DEMO = SyntheticSettings(**SMALL, noise=0.5, distance_mm=(600.0, 800.0))


@pytest.fixture(scope="session")
def frame():
    """A demo scene that shows the bear clearly."""
    scenes, bear = SyntheticScenes(DEMO), MODELS["bear"].object_id
    frames = [scenes.load(key) for key in scenes.keys]

    def visible(frame):
        bears = (t.visible_fraction for t in frame.targets if t.object_id == bear)
        return max(bears, default=0.0)

    return max(frames, key=visible)


@pytest.fixture
def image(frame):
    return frame.rgb, frame.depth, frame.camera_matrix


@pytest.fixture
def folder(learnt, tmp_path):
    """A copy of the learnt objects."""
    return Path(shutil.copytree(learnt, tmp_path / "learnt"))
