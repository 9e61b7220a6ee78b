"""A frame for the tests of the detector."""

import dataclasses

import pytest

from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings

DEMO = SyntheticSettings(
    scenes=12,
    seed=0,
    width=320,
    height=240,
    noise=0.5,
    min_visible=0.3,
    objects=(5, 5),
    clutter=(1, 3),
    distance_mm=(600.0, 800.0),
    elevation_deg=(20.0, 75.0),
    roll_deg=20.0,
    tilt_deg=5.0,
)


@pytest.fixture(scope="session")
def frame():
    """A demo scene that shows the bear clearly."""
    scenes = SyntheticScenes(dataclasses.replace(DEMO, scenes=12, width=320, height=240))
    frames = [scenes.load(key) for key in scenes.keys]
    bear = next(item.object_id for item in demo_objects().values() if item.name == "bear")
    return max(frames, key=lambda entry: visible(entry, bear))


def visible(frame, object_id):
    return max((t.visible_fraction for t in frame.targets if t.object_id == object_id), default=0.0)
