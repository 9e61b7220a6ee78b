"""A healthy data set: demo scenes with true poses, in which faults are planted."""

import pytest

from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from hlp.records import Frame, ObjectModel


@pytest.fixture(scope="session")
def models() -> dict[int, ObjectModel]:
    return demo_objects()


@pytest.fixture(scope="session")
def frames() -> list[Frame]:
    settings = SyntheticSettings(scenes=3, objects=(4, 4), clutter=(2, 3), width=320, height=240)
    scenes = SyntheticScenes(settings)
    return [scenes.load(key) for key in scenes.keys]
