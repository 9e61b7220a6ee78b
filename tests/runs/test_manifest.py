import json
from pathlib import Path

import pytest

from hlp.runs.manifest import poses_digest, read_manifest

HEADER = "scene_id,im_id,obj_id,score,R,t,time\n"


def test_digest_of_poses_leaves_out_the_time_and_nothing_else(tmp_path: Path) -> None:
    def digest(text: str) -> str:
        (tmp_path / "poses.csv").write_text(HEADER + text)
        return poses_digest(tmp_path / "poses.csv")

    first = digest("1,2,6,0.5,1 0 0 0 1 0 0 0 1,0 0 900.0,0.8\n")
    assert digest("1,2,6,0.5,1 0 0 0 1 0 0 0 1,0 0 900.0,0.1\n") == first
    assert digest("1,2,6,0.5,1 0 0 0 1 0 0 0 1,0 0 900.00000000000011,0.8\n") != first
    assert digest("1,2,6,0.4,1 0 0 0 1 0 0 0 1,0 0 900.0,0.8\n") != first
    assert digest("") != first


def test_what_is_no_manifest_is_named(tmp_path: Path) -> None:
    path = tmp_path / "manifest.json"
    with pytest.raises(FileNotFoundError, match=r"manifest\.json"):
        read_manifest(path)
    for text, words in (("{", "is not JSON"), ("[]", "no config"), ('{"config": 1}', "no config")):
        path.write_text(text)
        with pytest.raises(ValueError, match=words):
            read_manifest(path)
    path.write_text(json.dumps({"config": {"seed": 1}}))
    assert read_manifest(path) == {"config": {"seed": 1}}
