"""A sweep of the paper's, tiny, from the command line to its figure and table."""

import csv
from collections.abc import Callable

import pytest

from hlp.commands import report
from tiny_run import TinyRun

pytestmark = [pytest.mark.slow, pytest.mark.thorough]

Call = Callable[..., tuple[int, str, str]]


def test_sweep_and_report_write_the_papers_figure(
    tiny_run: TinyRun, call: Call, capsys: pytest.CaptureFixture[str]
) -> None:
    """Refined poses, and coarse ones; nothing is learnt again for either."""
    arms = ("experiment=pso_vs_icp", "refinement=icp,none", "output=outputs/pso_vs_icp/tiny")
    code, _, error = call(*tiny_run.overrides, *arms)
    assert code == 0, error
    folder = tiny_run.folder / "outputs" / "pso_vs_icp" / "tiny"
    with (folder / "pso_vs_icp.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["refinement"] for row in rows] == ["icp", "none"]
    assert rows[0]["targets"] == rows[1]["targets"]
    (folder / "pso_vs_icp.svg").unlink()
    report.command(["experiment=pso_vs_icp"])
    printed = capsys.readouterr().out
    assert "PSO against ICP" in printed
    assert "in 2 frames of synthetic data" in printed
    assert (folder / "pso_vs_icp.svg").is_file()
