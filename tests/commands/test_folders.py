"""`hlp notebooks` and `hlp clean`: what they copy, remove and refuse."""

import gc
import json
from pathlib import Path

import nbformat
import pytest

from hlp import files
from hlp.cli import main
from hlp.commands.folders import find_removable, remove
from hlp.errors import DataError, InputError
from hlp.stages.store import StageStore

NAMES = ["01_method.ipynb", "02_runs.ipynb", "03_own_object.ipynb", "04_ablations.ipynb"]
Out = pytest.CaptureFixture[str]


def test_notebooks_are_copied_and_named(tmp_path: Path, capsys: Out) -> None:
    folder = tmp_path / "deep" / "own"
    main(["notebooks", f"output={folder}"])
    assert capsys.readouterr().out.splitlines() == [f"{folder}/{name}" for name in NAMES]
    for name in NAMES:
        nbformat.validate(nbformat.read(folder / name, as_version=4))
        (folder / name).write_text("mine")


def test_none_is_copied_where_one_is_there(tmp_path: Path, fails) -> None:
    mine = tmp_path / NAMES[2]
    mine.write_text("mine")
    assert f"{mine} exists already" in fails("notebooks", f"output={tmp_path}")
    assert [path.name for path in tmp_path.iterdir()] == [mine.name]
    assert mine.read_text() == "mine"


def test_a_folder_that_cannot_be_made_or_is_not_shipped_is_one_line(
    tmp_path: Path, fails, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    fails("notebooks", f"output={tmp_path}/file")
    monkeypatch.setattr(files, "__file__", str(tmp_path / "lib" / "hlp" / "files.py"))
    assert "reinstall hlp" in fails("notebooks", f"output={tmp_path}")


USED, UNUSED, BEGUN = "0123456789abcdef", "f" * 16, "a" * 16


def write(folder):
    (folder / "data").write_bytes(bytes(1000))


def stop(folder):
    (folder / "half").write_bytes(bytes(500))
    raise KeyboardInterrupt


@pytest.fixture
def work(tmp_path):
    """A used, an unused, a partial and a damaged output, and other files."""
    work = tmp_path / "work"
    store = StageStore(work)
    for name in (USED, UNUSED):
        store.get_or_make("views", name, write, {})
    with pytest.raises(KeyboardInterrupt):
        store.get_or_make("codebook", BEGUN, stop, {})
    folder = store.get_or_make("codebook", USED, write, {})
    (folder / "data").write_bytes(b"")
    StageStore(work).get_or_make("codebook", USED, write, {})
    del store
    gc.collect()  # the traceback of the stopped one refers to its store
    (work / "mlflow.db").touch()
    (work / "mlflow-artifacts" / "1").mkdir(parents=True)
    return work


@pytest.fixture
def outputs(tmp_path):
    """Results of one run, which used an output of each stage."""
    folder = tmp_path / "outputs" / "demo" / "now"
    folder.mkdir(parents=True)
    stages = [{"stage": stage, "fingerprint": USED} for stage in ("views", "codebook")]
    (folder / "manifest.json").write_text(json.dumps({"config": {}, "stages": stages}))
    return tmp_path / "outputs"


def found(work, *outputs):
    listed = find_removable(work, outputs)
    return {(each.kind, each.folder.relative_to(work).as_posix()) for each in listed}


def test_lists_what_no_run_needs(work, outputs):
    begun, damaged = f"codebook/{BEGUN}.partial", f"codebook/{USED}.damaged"
    crashed = {("partial", begun), ("damaged", damaged)}
    assert found(work, outputs) == {*crashed, ("unreferenced", f"views/{UNUSED}")}
    assert found(work) == crashed  # nobody knows what is in use
    sizes = {each.folder.name: each.size for each in find_removable(work, [outputs])}
    assert sizes[f"{BEGUN}.partial"] == 500
    assert 1000 < sizes[UNUSED] < 3000  # with stage.json


@pytest.mark.parametrize("name", ["bolt-0a1b2c3d", UNUSED])
def test_learnt_objects_are_not_listed(work, outputs, name):
    before = found(work, outputs)
    folder = work / "objects" / name
    folder.mkdir(parents=True)
    (folder / "learnt.json").write_text("{}")
    assert found(work, outputs) == before


def test_clean_lists_and_removes_only_if_asked_to(work, outputs, monkeypatch, capsys, fails):
    monkeypatch.chdir(work.parent)
    before = found(work, outputs)
    main(["clean"])
    *listed, total = capsys.readouterr().out.splitlines()
    assert {line.split()[0] for line in listed} == {"partial", "damaged", "unreferenced"}
    assert total.startswith("3 outputs, 0.0 MB. Nothing was removed")
    assert found(work, outputs) == before
    main(["clean", "dry=false", "kinds=[partial,damaged]"])
    assert capsys.readouterr().out.endswith("2 outputs removed, 0.0 MB.\n")
    assert found(work, outputs) == {("unreferenced", f"views/{UNUSED}")}
    main(["clean", "dry=false"])
    left = {path.relative_to(work).as_posix() for path in work.glob("*/*") if path.is_dir()}
    assert left == {f"views/{USED}", f"codebook/{USED}", "mlflow-artifacts/1"}
    store = StageStore(work)
    assert not store.problem("views", USED) and not store.problem("codebook", USED)
    assert "kinds=whole: choose from" in fails("clean", "kinds=whole")
    assert "there is no folder nowhere" in fails("clean", "work=nowhere")


def test_nothing_is_removed_while_a_run_uses_the_store(work, outputs):
    pytest.importorskip("fcntl")
    store = StageStore(work)
    assert not store.problem("views", UNUSED)
    with pytest.raises(InputError, match="a run is using"):
        remove(work, find_removable(work, [outputs]))
    assert (work / "views" / UNUSED).is_dir()
    del store
    remove(work, find_removable(work, [outputs]))
    assert not (work / "views" / UNUSED).exists()


def test_a_broken_manifest_is_named(work, outputs):
    (manifest,) = outputs.rglob("manifest.json")
    manifest.write_text(json.dumps({"config": {}, "stages": [1]}))
    with pytest.raises(DataError, match=r"manifest\.json, stages: 0 is 1"):
        find_removable(work, [outputs])
    manifest.write_text("")
    with pytest.raises(DataError, match=r"manifest\.json is not JSON"):
        find_removable(work, [outputs])
