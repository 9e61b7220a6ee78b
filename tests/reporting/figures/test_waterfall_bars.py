from pathlib import Path
from typing import Any

import cv2
import pytest

from hlp.reporting.figures.bench_bars import draw_waterfall, stacked_bars


def waterfall() -> dict[str, Any]:
    cat = {"correct": 6, "no_window": 0, "few_votes": 1, "ranking": 1}
    ape = {"correct": 0, "no_window": 0, "few_votes": 2, "ranking": 0}
    total = {name: cat[name] + ape[name] for name in cat}
    return {
        "total": total,
        "per_object": {"cat": cat, "ape": ape},
        "per_visibility": {"0.3-0.6": ape, "0.6-1": cat},
    }


def test_bars_are_the_shares_lost_stacked_by_cause() -> None:
    left, right = stacked_bars(waterfall()).axes
    few, ranking = left.containers
    assert few.get_label() == "few votes"
    assert [bar.get_height() for bar in few] == pytest.approx([1 / 8, 1.0])
    assert [bar.get_y() for bar in ranking] == pytest.approx([1 / 8, 1.0])
    assert [bar.get_height() for bar in ranking] == pytest.approx([1 / 8, 0.0])
    assert [label.get_text() for label in left.get_xticklabels()] == ["cat\n8", "ape\n2"]
    assert [label.get_text() for label in right.get_xticklabels()] == ["0.3-0.6\n2", "0.6-1\n8"]


def test_the_legend_names_the_causes_that_lost_any() -> None:
    (legend,) = stacked_bars(waterfall()).legends
    assert [text.get_text() for text in legend.get_texts()] == ["ranking", "few votes"]


def test_png_and_svg_are_written_and_the_same_again(tmp_path: Path) -> None:
    draw_waterfall(tmp_path, waterfall())
    assert cv2.imread(str(tmp_path / "waterfall.png")).shape[1] > 400
    first = (tmp_path / "waterfall.svg").read_bytes()
    draw_waterfall(tmp_path, waterfall())
    assert (tmp_path / "waterfall.svg").read_bytes() == first


def test_nothing_lost_is_drawn_too(tmp_path: Path) -> None:
    cat = {"correct": 3, "ranking": 0}
    draw_waterfall(
        tmp_path, {"total": cat, "per_object": {"cat": cat}, "per_visibility": {"0.6-1": cat}}
    )
    assert (tmp_path / "waterfall.png").is_file()
