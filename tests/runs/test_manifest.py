"""What a manifest keeps; and what a stranger's could be made to do, which is refused."""

import json
import os
import sys
from typing import Any

import pytest

from hlp.errors import DataError
from hlp.runs.manifest import config_of, poses_digest, read_manifest

HEADER = "scene_id,im_id,obj_id,score,R,t,time\n"


def test_digest_of_poses_leaves_out_the_time_and_nothing_else(tmp_path):
    def digest(text):
        (tmp_path / "poses.csv").write_text(HEADER + text)
        return poses_digest(tmp_path / "poses.csv")

    first = digest("1,2,6,0.5,1 0 0 0 1 0 0 0 1,0 0 900.0,0.8\n")
    assert digest("1,2,6,0.5,1 0 0 0 1 0 0 0 1,0 0 900.0,0.1\n") == first
    assert digest("1,2,6,0.5,1 0 0 0 1 0 0 0 1,0 0 900.00000000000011,0.8\n") != first
    assert digest("1,2,6,0.4,1 0 0 0 1 0 0 0 1,0 0 900.0,0.8\n") != first
    assert digest("") != first


def test_what_is_no_manifest_is_named(tmp_path):
    path = tmp_path / "manifest.json"
    with pytest.raises(FileNotFoundError, match=r"manifest\.json"):
        read_manifest(path)
    for text, words in (("{", "is not JSON"), ("[]", "no config"), ('{"config": 1}', "no config")):
        path.write_text(text)
        with pytest.raises(ValueError, match=words):
            read_manifest(path)
    path.write_text(json.dumps({"config": {"seed": 1}}))
    assert read_manifest(path) == {"config": {"seed": 1}}


HARMLESS: dict[str, Any] = {
    "name": "demo",
    "seed": 0,
    "executor": {"name": "loky", "workers": 2, "threads": 1},
    "data": {"name": "linemod", "root": "/data/lm", "sizes": [1.0, 2.0], "objects": {"cat": 6}},
    "task": {"name": "search", "space": {"parameters": {"refinement.particles": {"low": 5}}}},
}

ATTACKS: dict[str, tuple[dict[str, Any], str]] = {
    "callback of Hydra": (
        {"hydra": {"callbacks": {"x": {"_target_": "os.system", "command": "touch x"}}}},
        "config.hydra is",
    ),
    "launcher by way of the defaults": (
        {"defaults": [{"override hydra/launcher": "slurm"}]},
        "config.defaults is",
    ),
    "class to create": ({"encoder": {"_target_": "os.mkdir", "path": "x"}}, "encoder._target_"),
    "class in a list": ({"data": {"a": [{"_target_": "os.mkdir"}]}}, r"data.a\[0\]._target_"),
    "environment": ({"data": {"root": "${oc.env:HOME}"}}, "data.root"),
    "environment with another spelling": ({"seed": "${ oc.env:SEED,1}"}, "seed"),
    "results elsewhere": ({"name": "../../../tmp/x"}, "name"),
    "study elsewhere": ({"task": {"space": {"name": "../../x"}}}, "task.space.name"),
    "drawing elsewhere": ({"task": {"refiners": {"../../x": {}}}}, "no key is a path"),
    "cluster of dask": ({"executor": {"name": "dask", "address": "tcp://evil:8786"}}, "address"),
}


def write(folder, **changes):
    path = folder / "manifest.json"
    path.write_text(json.dumps({"config": HARMLESS | changes, "stages": []}))
    return path


def test_settings_and_data_are_taken(tmp_path):
    composed = json.loads(config_of(write(tmp_path), []))
    assert {key: composed[key] for key in HARMLESS} == HARMLESS


@pytest.mark.parametrize("attack", ATTACKS)
def test_attacks_are_refused_by_file_and_key(tmp_path, attack):
    changes, message = ATTACKS[attack]
    with pytest.raises(DataError, match=rf"manifest\.json: .*{message}"):
        config_of(write(tmp_path, **changes), [])


def test_ones_own_cluster_may_be_named(tmp_path):
    manifest = write(tmp_path, executor={"name": "dask", "address": "tcp://mine:8786"})
    own = ["executor.address=tcp://mine:8786"]
    assert "tcp://mine" in config_of(manifest, own)


def test_deep_nesting_is_refused(tmp_path):
    nested: Any = 1
    for _ in range(200):
        nested = [nested]
    with pytest.raises(DataError, match="nested deeper than"):
        config_of(write(tmp_path, data=nested), [])
    path = tmp_path / "manifest.json"
    path.write_text('{"config": ' + "[" * 200_000)
    with pytest.raises(DataError, match="nested deeper than"):
        config_of(path, [])


def test_the_command_runs_nothing_of_it(tmp_path, monkeypatch, fails):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", sys.argv)
    callback = {"x": {"_target_": "os.mkdir", "path": str(tmp_path / "touched")}}
    write(tmp_path, hydra={"callbacks": callback})
    for variable in ("HYDRA_FULL_ERROR", "OMP_WAIT_POLICY", "MPLBACKEND"):
        monkeypatch.setenv(variable, os.environ.get(variable, "1"))
    line = fails("run", "manifest=manifest.json")
    assert line.startswith("hlp: manifest.json: config.hydra is")
    assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"]
