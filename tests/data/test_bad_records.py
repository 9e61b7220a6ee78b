"""JSON in general, and records of runs that are none; results of others are fuzzed."""

from pathlib import Path

import pytest

from bad_input import DEEP, Case, check, of_file, written
from hlp.files import read_json
from hlp.method.learn.learnt_folder import read_record
from hlp.reporting.results import read_results
from hlp.results.summary_file import read_summary

BROKEN_JSON = {
    "": "is not JSON",
    "{": "is not JSON",
    '{"1": 1, "1": 2}': "states the key '1' twice",
    DEEP: "nested deeper than 64",
    "[" * 80 + "]" * 80: "nested deeper than 64",
}
CASES: dict[str, Case] = {
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
    "summary: empty": (of_file(read_summary, "summary.json", "{}"), "it lacks metrics"),
    "results: no manifest": (
        lambda folder: read_results(written(folder / "summary.json", "{}").parent),
        "manifest.json",
    ),
    "sweep: no keys": (
        lambda folder: read_results(written(folder / "sweep.json", "{}").parent),
        "",
    ),
    "learnt: none": (read_record, "holds no learnt objects"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_wrong_is_said_by_an_error_of_our_own(tmp_path: Path, case: str) -> None:
    check(CASES[case], tmp_path)
