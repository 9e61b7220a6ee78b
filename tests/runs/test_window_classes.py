"""Classes of the windows at targets, by a network that answers by what it is shown."""

from types import SimpleNamespace

import numpy as np

from hlp.patches.holistic import HolisticSettings
from hlp.records import Frame, Target
from hlp.runs.diagnosis import WindowClasses


class ByBrightness:
    """Background in the dark, class 1 in grey, class 2 in light windows."""

    outputs = 3

    def run(self, images):
        level = images[..., :3].mean(axis=(1, 2, 3))
        return np.eye(3, dtype=np.float32)[np.digitize(level, [80, 170])]


def test_windows_are_counted_by_object_and_class_and_unseen_targets_are_not():
    models = {i: SimpleNamespace(name=n, holistic_size=0.1) for i, n in ((5, "cat"), (9, "duck"))}
    patches = SimpleNamespace(holistic=HolisticSettings())
    settings = SimpleNamespace(patches=patches, machine=SimpleNamespace(threads=1))
    training = SimpleNamespace(
        models=models, classes=[5, 9], settings=settings, load_classifier=ByBrightness
    )
    rgb = np.zeros((120, 400, 3), np.uint8)
    rgb[:, 130:270], rgb[:, 270:] = 120, 250
    camera = np.array([[500.0, 0, 200], [0, 500.0, 60], [0, 0, 1]])
    frame = Frame(0, 0, rgb, np.ones((120, 400)), camera)
    # 50 px wide at 1 m: each window lies in one of the three stripes.
    shown = [(9, (330, 60)), (5, (200, 60)), (5, (60, 60)), (5, (330, 60)), (9, None)]
    targets = (SimpleNamespace(target=Target(i, np.eye(4)), middle=middle) for i, middle in shown)
    notes = SimpleNamespace(targets=tuple(targets))
    classes = WindowClasses(training)
    classes.count(frame, notes)
    found = classes.summary()
    assert found == {"cat": {"background": 1, "cat": 1, "duck": 1}, "duck": {"duck": 1}}
    assert list(found) == ["cat", "duck"]
