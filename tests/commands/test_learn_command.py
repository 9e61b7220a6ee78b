"""What `hlp learn` makes of its arguments."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from hlp.commands.learn import learning_request
from hlp.method.settings import MethodSettings


@pytest.fixture
def mesh(tmp_path: Path) -> str:
    path = tmp_path / "part.ply"
    trimesh.creation.box(np.array([0.1, 0.06, 0.04])).export(path)
    return str(path)


def test_objects_are_learnt_in_any_pose_not_with_the_settings_of_the_demo(mesh: str) -> None:
    settings = learning_request({}, [mesh], ()).settings
    assert settings == MethodSettings()


def test_keys_and_groups_of_the_method_can_be_changed(mesh: str) -> None:
    request = learning_request({"encoder": "pca", "rendering.viewpoints": "99"}, [mesh], ())
    assert request.settings.encoder.name == "pca"
    assert request.settings.rendering.viewpoints == 99
