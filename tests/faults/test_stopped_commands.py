"""The commands for users of learnt objects, and others that write, killed at named places."""

import json
import shutil
import signal

import pytest
from process import stop_hlp

from forked_hlp import succeed
from frame_files import write_image
from hlp.runs.manifest import poses_digest
from run_files import logged_runs

pytestmark = [pytest.mark.slow, pytest.mark.thorough]


@pytest.fixture
def folder(learnt, scenes, tmp_path):
    """Learnt objects in `work`, two frames, and nothing else."""
    shutil.copytree(learnt, tmp_path / "work" / "objects" / "both")
    for key, name in zip(scenes.keys, "ab", strict=True):
        frame = scenes.load(key)
        write_image(tmp_path, name, frame)
    (tmp_path / "camera.txt").write_text(
        "\n".join(" ".join(map(str, row)) for row in frame.camera_matrix.tolist())
    )
    return tmp_path


def kill(folder, place, *arguments):
    return stop_hlp(folder, place, signal.SIGKILL, *arguments).stdout


@pytest.mark.parametrize("place", ["copy begun", "copy made"])
def test_objects_export(folder, place):
    export = ("objects", "export", "both", "copy", "work=work")
    kill(folder, place, *export)
    assert not (folder / "copy").exists()
    succeed(folder, *export)
    source = folder / "work" / "objects" / "both"
    for path in source.rglob("*"):
        copied = folder / "copy" / path.relative_to(source)
        assert path.is_dir() or copied.read_bytes() == path.read_bytes()
    assert not (folder / ".copy.partial").exists()


@pytest.mark.parametrize("place", ["entry hidden", "entry half removed"])
def test_objects_remove(folder, place):
    cache = folder / "work" / "objects"
    shutil.copytree(cache / "both", cache / "other")
    kill(folder, place, "objects", "remove", "both", "work=work")
    listed = succeed(folder, "objects", "list", "work=work").stdout.splitlines()
    assert [line.split()[0] for line in listed[:-1]] == ["other"]
    succeed(folder, "objects", "remove", "other", "work=work")
    assert list(cache.iterdir()) == []


PREDICT = ("predict", "learnt=both", "rgb=rgb", "depth=depth", "intrinsics=camera.txt", "work=work")


def test_predict(folder):
    """The same command continues after what was answered, to the poses of an undisturbed one.

    The document of all answers is there only when they are all in it.
    """
    succeed(folder, *PREDICT, "output=whole")
    for place, answered in (("first answer", 0), ("second answer", 1), ("last answer", 2)):
        kill(folder, place, *PREDICT, "output=last")
        lines = (folder / "last" / "poses.jsonl").read_text().splitlines()
        assert len([json.loads(line) for line in lines]) >= answered
        assert not (folder / "last" / "poses.json").exists()
    succeed(folder, *PREDICT, "output=last")
    first, second = (poses_digest(folder / name / "poses.csv") for name in ("whole", "last"))
    assert first == second
    assert (folder / "last" / "poses.json").is_file()


@pytest.fixture(scope="module")
def unsent(tiny_run, tmp_path_factory):
    """A folder with a run that its server has missed."""
    folder = tmp_path_factory.mktemp("unsent")
    shutil.copytree(tiny_run.folder / "work", folder / "work")
    away = "reporting.uri=http://127.0.0.1:9"
    succeed(folder, "run", *tiny_run.overrides, "output=run", away)
    return folder


@pytest.mark.parametrize(
    ("place", "left"), [("run created", 1), ("artifacts sent", 1), ("run sent", 0)]
)
def test_upload(unsent, tmp_path, place, left):
    """No run reaches the server twice, and each reaches it whole."""
    shutil.copytree(unsent / "work" / "unsent", tmp_path / "work" / "unsent")
    upload = ("upload", "uri=sqlite:///server/mlflow.db")
    (tmp_path / "server").mkdir()
    kill(tmp_path, place, *upload)
    assert f"{left} runs sent" in succeed(tmp_path, *upload).stdout
    client, (run,) = logged_runs(tmp_path, "server")
    assert run.info.status == "FINISHED"
    assert "config.yaml" in {item.path for item in client.list_artifacts(run.info.run_id)}
    assert "add" in run.data.metrics
    assert not (tmp_path / "work" / "unsent").exists()
