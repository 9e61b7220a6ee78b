import pytest

from hlp.data.frame_paths import with_frames
from hlp.errors import InputError, MissingFileError


@pytest.fixture
def root(tmp_path):
    for name in ("rgb", "depth"):
        (tmp_path / name).mkdir()
    return tmp_path


@pytest.mark.parametrize("camera", ["cam_K.txt", "camera.json", "scene_camera.json"])
def test_a_folder_stands_for_what_is_in_it(root, camera):
    (root / camera).touch()
    given = with_frames({"frames": str(root), "learnt": "x"})
    assert given == {
        "rgb": str(root / "rgb"), "depth": str(root / "depth"), "intrinsics": str(root / camera),
        "learnt": "x",
    }  # fmt: skip
    other = with_frames({"frames": str(root), "intrinsics": "[1,2,3,4]"})
    assert other["intrinsics"] == "[1,2,3,4]"
    assert with_frames({"rgb": "a"}) == {"rgb": "a"}


def test_what_is_missing_is_named(root):
    with pytest.raises(MissingFileError, match=r"has no cam_K\.txt or camera\.json.*intrinsics=…"):
        with_frames({"frames": str(root)})
    (root / "depth").rmdir()
    with pytest.raises(MissingFileError, match="has no depth: give depth=…"):
        with_frames({"frames": str(root)})
    with pytest.raises(MissingFileError, match="frames is no folder"):
        with_frames({"frames": str(root / "none")})
    with pytest.raises(InputError, match="frames and rgb"):
        with_frames({"frames": str(root), "rgb": "x"})
