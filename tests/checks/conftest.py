"""A healthy data set: demo scenes with true poses, in which faults are planted."""

import pytest

from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings


@pytest.fixture(scope="session")
def models():
    return demo_objects()


@pytest.fixture(scope="session")
def frames():
    settings = SyntheticSettings(scenes=3, objects=(4, 4), clutter=(2, 3), width=320, height=240)
    scenes = SyntheticScenes(settings)
    return [scenes.load(key) for key in scenes.keys]
