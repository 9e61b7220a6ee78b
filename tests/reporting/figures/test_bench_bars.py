"""The picture of a bench: a stacked bar for each path and unit."""

import pytest

from hlp.reporting.figures.bench_bars import bench_bars
from written_bench import bench_result


def test_bars_are_the_stages_medians_one_after_another() -> None:
    result = bench_result()
    first = {
        "network": {"median_ms": 9.0},
        "stage 1": {"median_ms": 10.0},
        "stage 2": {"median_ms": 30.0},
        "total": {"median_ms": 41.0},
    }
    result["paths"]["configured"] |= {"first": first, "further": {}}  # one object a frame
    (ax,) = bench_bars(result).axes
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == [
        "configured: first", "configured: frame",
        "reference: first", "reference: further", "reference: frame",
    ]  # fmt: skip
    bars = [(bar.get_x(), bar.get_width()) for bar in ax.patches[:2]]
    assert bars == [(0.0, 10.0), (10.0, 30.0)]
    widths = [bar.get_width() for bar in ax.patches[4::2]]  # stage 1 only
    assert widths == pytest.approx([30.0, 7.5, 60.0])
    said = [text.get_text() for text in ax.texts]
    assert said[:3] == ["10.0", "30.0", "41.0"]
    assert ax.get_xlim()[1] > 60.0
