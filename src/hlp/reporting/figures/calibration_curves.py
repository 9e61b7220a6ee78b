"""Reliability diagram and risk–coverage curve of a run's scores."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hlp.reporting.figures.saving import save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_calibration(folder: Path, calibration: Mapping[str, Any]) -> None:
    """Write calibration.png and calibration.svg; nothing without any answer.

    `calibration` is the part of that name in `summary.json`.
    """
    if calibration["answers"]:
        save_figure(calibration_figure(calibration), folder / "calibration")


def calibration_figure(calibration: Mapping[str, Any]) -> "Figure":
    """Left: how often answers of about one score are right. Right: risk by coverage."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    most = max(row[0] for row in calibration["reliability"])
    left.plot([0, 1], [0, 1], color="0.6", linewidth=1)
    for count, score, share in calibration["reliability"]:
        left.plot(score, share, "o", color="tab:blue", markersize=3 + 9 * (count / most) ** 0.5)
    left.set(xlabel="mean score", ylabel="share of right answers", xlim=(0, 1), ylim=(0, 1.02))
    left.set_title(f"expected calibration error {calibration['ece']:.3f}")
    coverage, risk = zip(*calibration["risk_coverage"], strict=True)
    right.step(coverage, risk, where="post", color="tab:red")
    right.set(xlabel="coverage", ylabel="risk: share of wrong answers", xlim=(0, 1))
    right.set_ylim(0, max(0.05, 1.1 * max(risk)))
    right.set_title(f"area under the curve {calibration['aurc']:.4f}")
    figure.suptitle(f"{calibration['answers']} answers; right: ADD-S < 10 % of the diameter")
    return figure
