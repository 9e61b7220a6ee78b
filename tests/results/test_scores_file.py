import csv
import math

import pytest

from hlp.records import TargetScore
from hlp.results.poses_file import read_scores, write_scores


def _score(found):
    worst = float("inf")
    return TargetScore(
        6, 12, 1, found, 0.25, *((0.004, 0.1, 0.02) if found else (worst,) * 3),
        0.75 if found else 0.0, found, False, found, 0.5, 0.25,
    )  # fmt: skip


def test_scores_come_back_as_they_were(tmp_path):
    path = tmp_path / "scores.csv"
    write_scores(path, [_score(True), _score(False)], {1: "ape"})
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert rows[0]["object"] == "ape" and float(rows[0]["add_mm"]) == pytest.approx(4.0)
    assert float(rows[0]["rotation_deg"]) == pytest.approx(math.degrees(0.1))
    assert rows[1]["add_mm"] == "inf" and rows[1]["add_correct"] == "0"
    (found, lost), names = read_scores(path)
    assert names == {1: "ape"}
    for back, sent in ((found, _score(True)), (lost, _score(False))):
        for key in TargetScore.__dataclass_fields__:
            assert getattr(back, key) == pytest.approx(getattr(sent, key), nan_ok=True), key


def test_a_broken_score_is_an_error_that_names_the_line(tmp_path):
    path = tmp_path / "scores.csv"
    write_scores(path, [_score(True)], {1: "ape"})
    path.write_text(path.read_text().replace(",0.25,", ",x,"))
    with pytest.raises(ValueError, match="line 2"):
        read_scores(path)


def test_an_absent_file_and_other_columns_are_named(tmp_path):
    path = tmp_path / "scores.csv"
    with pytest.raises(FileNotFoundError, match=r"scores\.csv"):
        read_scores(path)
    path.write_text("scene_id,im_id\n")
    with pytest.raises(ValueError, match=r"scores\.csv: the first line must be"):
        read_scores(path)
