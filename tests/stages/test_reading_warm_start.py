import json
from pathlib import Path

import pytest

from hlp.errors import DataError, MissingFileError
from hlp.stages.store import StageStore
from hlp.stages.warm_start import read_warm_start
from tiny_method import tiny_method

NAME = "0123456789abcdef"


def start(folder: Path, stages: object) -> None:
    (folder / "manifest.json").write_text(json.dumps({"config": {}, "stages": stages}))
    store = StageStore(folder / "work")
    read_warm_start(folder / "manifest.json", tiny_method(), {}, store)


@pytest.mark.parametrize("name", ["../../secret", "/etc", "", "0123456789ABCDEF", NAME + "0", 7])
def test_a_manifest_names_no_other_folder(tmp_path: Path, name: object) -> None:
    with pytest.raises(DataError, match=r"manifest\.json: .* is no fingerprint"):
        start(tmp_path, [{"stage": "classifier", "fingerprint": name}])


@pytest.mark.parametrize("stages", [1, [1], [{}], "abc", [{"stage": "classifier"}]])
def test_a_damaged_manifest_is_named(tmp_path: Path, stages: object) -> None:
    with pytest.raises(DataError, match=r"manifest\.json is damaged"):
        start(tmp_path, stages)


def test_a_missing_and_a_damaged_classifier_are_named(tmp_path: Path) -> None:
    stages = [{"stage": "classifier", "fingerprint": NAME}]
    with pytest.raises(MissingFileError, match="has no classifier"):
        start(tmp_path, stages)
    store = StageStore(tmp_path / "work")
    folder = store.get_or_make("classifier", NAME, lambda folder: (folder / "x").touch(), {})
    (folder / "x").write_bytes(b"more")
    with pytest.raises(DataError, match=f"{NAME}/x is missing or damaged"):
        start(tmp_path, stages)
