"""The run that the tests of this folder disturb: smaller still than that of all other tests."""

import os

import pytest

from frame_files import write_bop_set
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from tiny_run import TINY, make_tiny_run

os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")  # it is imported before HLP could say so

SCENES = SyntheticSettings(scenes=2, width=320, height=240, objects=(5, 5), clutter=(1, 3))
OBJECTS = 2


@pytest.fixture(scope="session")
def scenes():
    """The frames of all tests here."""
    return SyntheticScenes(SCENES)


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory, scenes):
    """A run of two objects in two frames, which are files."""

    def overrides(folder):
        if not (folder / "set").is_dir():
            frames = [scenes.load(key) for key in scenes.keys]
            shown = ({target.object_id for target in frame.targets} for frame in frames)
            write_bop_set(folder / "set", frames, sorted(set.intersection(*shown))[:OBJECTS])
        settings = (setting for setting in TINY if not setting.startswith("data."))
        return ("data=bop", f"data.root={folder / 'set'}", *settings)

    return make_tiny_run(tmp_path_factory, "faults", overrides)
