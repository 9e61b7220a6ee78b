from pathlib import Path

import numpy as np

from hlp.reporting.figures import save_jpeg
from hlp.reporting.figures.stage_figures import SwarmsOfTarget, swarm_figure


def test_the_swarms_of_each_target_have_a_panel(tmp_path: Path) -> None:
    costs = np.array([[0.6, 0.5], [0.4, 0.7], [0.5, 0.8]])
    targets = [
        SwarmsOfTarget("a", [costs, costs + 0.1], 0, 0.15, 0.18),
        SwarmsOfTarget("b", [costs + 0.1], None, 0.1, None),
    ]
    figure = swarm_figure(targets)
    first, second = figure.axes
    lines = {str(line.get_label()): line for line in first.lines}
    np.testing.assert_allclose(lines["best of the chosen swarm"].get_ydata(), [0.5, 0.4, 0.4])
    np.testing.assert_allclose(lines["best of another swarm"].get_ydata(), [0.6, 0.5, 0.5])
    np.testing.assert_allclose(lines["true pose"].get_ydata(), 0.15)
    star = lines["answer"]
    assert (*star.get_xdata(), *star.get_ydata()) == (2, 0.18)
    others = {str(line.get_label()) for line in second.lines}
    assert others == {"best of another swarm", "true pose"}
    assert "closer look" not in figure.get_suptitle()
    save_jpeg(figure, tmp_path / "swarms.jpg")
    assert 5000 < (tmp_path / "swarms.jpg").stat().st_size < 200_000


def test_an_answer_that_no_shown_swarm_has_found_is_shown_beside_them() -> None:
    swarm = np.array([[0.6], [0.5], [0.4]])
    figure = swarm_figure([SwarmsOfTarget("a", [swarm], None, 0.1, 0.3)])
    (star,) = [line for line in figure.axes[0].lines if line.get_label() == "answer"]
    assert (*star.get_xdata(), *star.get_ydata()) == (2, 0.3)
    assert "closer look" in figure.get_suptitle()
