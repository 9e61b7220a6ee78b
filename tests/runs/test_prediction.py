"""`predict` around a detector that stands in for the real one: what is said, and when."""

import json
import logging
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from hlp.checks.finding import Finding
from hlp.data.own_frames import FrameFiles, OwnFrames
from hlp.errors import DataError
from hlp.method.detections import Rejection, SearchResult
from hlp.reporting import answers
from hlp.runs import prediction
from hlp.runs.prediction import PredictionOptions, predict


class Nothing:
    """A detector that finds nothing, of an object that it knows."""

    def __init__(self, models: dict[str, Any]) -> None:
        self.models = models

    def search(self, *_: Any) -> SearchResult:
        return SearchResult([], [Rejection("bear", "nothing looks like it", None)])


@pytest.fixture
def detector() -> Any:
    from hlp.data.synthetic.objects import demo_objects

    return Nothing({m.name: m for m in demo_objects().values() if m.name == "bear"})


def frames(folder: Path, broken: tuple[int, ...], count: int = 3) -> OwnFrames:
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    for i in range(count):
        cv2.imwrite(str(folder / f"rgb/{i}.png"), np.zeros((24, 32, 3), np.uint8))
        cv2.imwrite(str(folder / f"depth/{i}.png"), np.full((24, 32), 700, np.uint16))
    for i in broken:
        (folder / f"depth/{i}.png").write_bytes(b"no image")
    rgb, depth = str(folder / "rgb"), str(folder / "depth")
    camera = [30.0, 30.0, 15.5, 11.5]
    return OwnFrames(FrameFiles(rgb=rgb, depth=depth, intrinsics=camera, depth_scale=1.0))


def test_a_broken_first_frame_keeps_neither_the_header_nor_the_checks_from_the_others(
    detector: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    capsys: pytest.CaptureFixture[str],
) -> None:
    checked = list[str]()

    def check(examined: list[Any], _: object) -> list[Finding]:
        checked.extend(each.key for each in examined)
        return [Finding("depth scale", "here", "depth is odd", "Mend it")]

    monkeypatch.setattr(prediction, "check_frames", check)
    with caplog.at_level(logging.INFO):
        used = predict(detector, frames(tmp_path, (0,)), tmp_path / "out", PredictionOptions())
    assert used == 2
    assert checked == ["000000_000001"]
    assert "depth is odd" in caplog.text and "1 of 3 frames could not be used" in caplog.text
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == answers.HEADER and printed.count(answers.HEADER) == 1
    assert len(printed) == 3
    lines = [json.loads(x) for x in (tmp_path / "out" / "poses.jsonl").read_text().splitlines()]
    assert ["error" in each for each in lines] == [True, False, False]


@pytest.mark.parametrize("count", [1, 2])
def test_without_any_answer_no_header_stands_above_the_error(
    detector: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str], count: int
) -> None:
    all_broken = frames(tmp_path, tuple(range(count)), count)
    with pytest.raises(DataError):
        predict(detector, all_broken, tmp_path / "out", PredictionOptions())
    assert capsys.readouterr().out == ""
