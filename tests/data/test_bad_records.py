"""JSON in general, and what HLP itself writes: manifests, summaries, sweeps, poses."""

from pathlib import Path
from typing import Any

import pytest

from bad_input import DEEP, Case, check, of_file, written
from hlp.files import read_json
from hlp.method.learn.learnt_folder import read_record
from hlp.refinement.score_model import load_score_model
from hlp.reporting.results import read_results
from hlp.results.poses_file import read_poses
from hlp.results.summary_file import read_summary
from hlp.stages.manifest import read_manifest

BROKEN_JSON = {
    "": "is no JSON",
    "{": "is no JSON",
    '{"1": 1, "1": 2}': "states the key '1' twice",
    DEEP: "nested deeper than 64",
    '{"a":' * 100_000: "nested deeper than 64",
    "[" * 80 + "]" * 80: "nested deeper than 64",
}
JSON: dict[str, Case] = {
    f"json {text[:20]!r} {len(text)}": (of_file(read_json, "a.json", text), said)
    for text, said in BROKEN_JSON.items()
} | {
    "json in UTF-16": (of_file(read_json, "a.json", '{"a": 1}'.encode("utf-16")), "UTF-8"),
    "json that is a folder": (read_json, "there is no file"),
    "no json": (lambda folder: read_json(folder / "none.json"), "there is no file"),
    "large json": (
        lambda folder: read_json(written(folder / "a.json", "[" + "1," * 99 + "1]"), 100),
        "has 201 bytes: at most 100",
    ),
}


def run_folder(files: dict[str, str]) -> Any:
    def read(folder: Path) -> object:
        for name, text in files.items():
            written(folder / name, text)
        return read_results(folder)

    return read


HEADER = "scene_id,im_id,obj_id,score,R,t,time\n"
FINE = "1,2,3,0.5,1 0 0 0 1 0 0 0 1,0 0 700,-1\n"
RECORDS: dict[str, Case] = {
    "manifest: none": (lambda folder: read_manifest(folder / "manifest.json"), "there is no file"),
    "manifest: config null": (
        of_file(read_manifest, "manifest.json", '{"config": null}'),
        "no manifest of a run",
    ),
    "summary: empty": (of_file(read_summary, "summary.json", "{}"), "it lacks metrics"),
    "results: no manifest": (run_folder({"summary.json": "{}"}), "manifest.json"),
    "sweep: no keys": (run_folder({"sweep.json": "{}"}), ""),
    "learnt: none": (read_record, "holds no learnt objects"),
    "learnt: a list": (
        lambda folder: read_record(written(folder / "learnt.json", "[]").parent),
        "format is []",
    ),
    "learnt: another format": (
        lambda folder: read_record(written(folder / "learnt.json", '{"format": 99}').parent),
        "format is 99",
    ),
    "score: none": (load_score_model, "is missing"),
}
for _column, _value in (
    ("scene_id", "x"), ("im_id", "1.5"), ("obj_id", ""), ("score", "high"), ("score", ""),
    ("R", "1 0 0"), ("R", "a b c"), ("R", ""), ("t", "0 0"), ("t", "x y z"), ("time", "soon"),
):  # fmt: skip
    _row = dict(zip(HEADER.strip().split(","), FINE.strip().split(","), strict=True))
    _text = HEADER + ",".join({**_row, _column: _value}.values()) + "\n"
    RECORDS[f"poses: {_column} {_value!r}"] = (of_file(read_poses, "poses.csv", _text), "poses.csv")

CASES = {**JSON, **RECORDS}


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path: Path, case: str) -> None:
    check(CASES[case], tmp_path)
