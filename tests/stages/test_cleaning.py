import gc
import json

import pytest

from hlp.commands.folders import find_removable, remove
from hlp.errors import DataError, InputError, MissingFileError
from hlp.stages.store import StageStore

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


@pytest.mark.parametrize("name", ["bolt", "bolt-0a1b2c3d", UNUSED, "e" * 16])
def test_learnt_objects_are_not_listed(work, outputs, name):
    before = found(work, outputs)
    folder = work / "objects" / name
    folder.mkdir(parents=True)
    (folder / "learnt.json").write_text("{}")
    assert found(work, outputs) == before


def test_removes_what_it_lists(work, outputs):
    remove(work, find_removable(work, [outputs]))
    assert found(work, outputs) == set()
    left = {path.relative_to(work).as_posix() for path in work.glob("*/*") if path.is_dir()}
    assert left == {f"views/{USED}", f"codebook/{USED}", "mlflow-artifacts/1"}
    store = StageStore(work)
    assert store.holds("views", USED) and store.holds("codebook", USED)


def test_nothing_is_removed_while_a_run_uses_the_store(work, outputs):
    pytest.importorskip("fcntl")
    store = StageStore(work)
    assert store.holds("views", UNUSED)
    with pytest.raises(InputError, match="a run is using"):
        remove(work, find_removable(work, [outputs]))
    assert (work / "views" / UNUSED).is_dir()
    del store
    remove(work, find_removable(work, [outputs]))
    assert not (work / "views" / UNUSED).exists()


def test_a_broken_manifest_and_a_missing_store_are_named(work, outputs):
    (manifest,) = outputs.rglob("manifest.json")
    manifest.write_text(json.dumps({"config": {}, "stages": [1]}))
    with pytest.raises(DataError, match=r"manifest\.json is damaged"):
        find_removable(work, [outputs])
    manifest.write_text("")
    with pytest.raises(DataError, match=r"manifest\.json is not JSON"):
        find_removable(work, [outputs])
    with pytest.raises(MissingFileError, match="nowhere"):
        find_removable(work / "nowhere", [outputs])
