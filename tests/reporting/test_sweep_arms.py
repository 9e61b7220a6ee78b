import base64
import json
import re
from pathlib import Path

import numpy as np
import pytest

from hlp.records import TargetScore
from hlp.reporting.report import write_pages
from hlp.reporting.results import read_results
from hlp.reporting.sweep_arms import sweep_of, sweep_table, sweep_verdict
from hlp.reporting.sweep_report import describe_sweep, sweep_figure, write_sweep_files
from hlp.results.poses_file import write_scores
from written_results import scored, write_run, write_sweep

PARTICLES = "refinement.particles"


def write_arm(folder: Path, chosen: dict[str, str], right: int, ms: float) -> None:
    """A run of twenty targets in ten frames of which so many are right, the first ones."""
    overrides = [f"{key}={value}" for key, value in chosen.items()]
    write_run(folder, "demo", scored(right / 20, ms, {"cat": right / 20}), overrides)
    scores = [
        TargetScore(1, i // 2, 6, True, 1.0, 0.01, 0.1, 0.01, 0.9, i < right, True, True)
        for i in range(20)
    ]
    write_scores(folder / "scores.csv", scores, {6: "cat"})


@pytest.fixture
def sweep(tmp_path: Path) -> Path:
    """Three arms, the second is the default; the third has failed."""
    folder = write_sweep(tmp_path / "sweep", [PARTICLES], [f"{PARTICLES}=5,25,50"])
    record = json.loads((folder / "sweep.json").read_text())
    record["defaults"] = {PARTICLES: "25.0"}
    (folder / "sweep.json").write_text(json.dumps(record))
    write_arm(folder / "0", {PARTICLES: "5"}, 12, 30.0)
    write_arm(folder / "1", {PARTICLES: "25"}, 18, 50.0)
    (folder / "2" / ".hydra").mkdir(parents=True)
    (folder / "2" / ".hydra" / "overrides.yaml").write_text(json.dumps([f"{PARTICLES}=50"]))
    return folder


def test_arms_are_compared_with_the_default_target_by_target(sweep: Path) -> None:
    found = sweep_of(read_results(sweep))
    assert found.is_default and found.reference is found.arms[1]
    difference = found.difference(found.arms[0])
    assert difference is not None
    value, (low, high) = difference
    assert value == pytest.approx(-6 / 20)
    # Three of ten frames lose both of their targets: a binomial share of frames.
    drawn = -np.random.default_rng(1).binomial(10, 0.3, 100_000) / 10
    assert (low, high) == pytest.approx(tuple(np.percentile(drawn, [2.5, 97.5])), abs=0.051)
    assert found.difference(found.arms[1]) is None


def test_the_whole_table_has_bops_recall_and_cpu_time_and_load_beside_the_time(sweep: Path) -> None:
    summary = sweep / "1" / "summary.json"
    timing = {"cpu_ms": 71.6, "wall_ms": 50.0, "load": 1.26, "cores": 2}
    more = {"timing": timing, "bop": {"ar": 0.654}}
    summary.write_text(json.dumps({**json.loads(summary.read_text()), **more}))
    table = sweep_table(sweep_of(read_results(sweep)))
    rows = [dict(zip(table.header, row, strict=True)) for row in table.rows]
    shown = [[row[name] for name in ("ms", "ms 95 %", "CPU ms", "load")] for row in rows]
    assert shown == [["30", "60", "", ""], ["50", "100", "72", "1.3"], ["", "", "", ""]]
    assert [row["AR"] for row in rows] == ["", "0.654", ""]


def test_the_table_has_the_best_and_the_failed_arm_and_fits_a_terminal(sweep: Path) -> None:
    text = describe_sweep(sweep, "text")
    table = sweep_table(sweep_of(read_results(sweep)), whole=False)
    rows = [dict(zip(table.header, row, strict=True)) for row in table.rows]
    assert [row["particles"] for row in rows] == ["5", "25 *", "50"]
    assert [row["ADD(-S)"] for row in rows] == ["0.600", "0.900", "no result"]
    assert [row["to default"] for row in rows] == ["-0.300", "default", ""]
    assert max(map(len, table.text().splitlines())) <= 80
    words = " ".join(text.split())
    assert "2 of 3 arms finished; best by ADD(-S): particles 25 (0.900, 50 ms)" in words
    assert "without a result: particles 50 (see 2/hlp.log)" in words
    assert max(map(len, text.splitlines())) <= 80


def test_without_a_default_among_them_the_first_arm_is_compared_with(sweep: Path) -> None:
    record = json.loads((sweep / "sweep.json").read_text())
    (sweep / "sweep.json").write_text(json.dumps({**record, "defaults": {PARTICLES: "7"}}))
    found = sweep_of(read_results(sweep))
    assert not found.is_default and found.reference is found.arms[0]
    assert "+0.300 against the first arm, not surely more (+0.000" in sweep_verdict(found)


@pytest.mark.parametrize(
    ("right", "of_default", "spread"),
    [(18, 18, "+0.000 (-0.161 to +0.161)"), (20, 18, "+0.100 (+0.000 to"), (18, 4, None)],
)
def test_the_default_wins_a_tie(
    tmp_path: Path, right: int, of_default: int, spread: str | None
) -> None:
    """A faster arm that is right for as many targets, or for few more, is no better one."""
    folder = write_sweep(tmp_path / "sweep", [PARTICLES], [f"{PARTICLES}=5,25"])
    record = json.loads((folder / "sweep.json").read_text())
    (folder / "sweep.json").write_text(json.dumps({**record, "defaults": {PARTICLES: "25"}}))
    write_arm(folder / "0", {PARTICLES: "5"}, right, 30.0)
    write_arm(folder / "1", {PARTICLES: "25"}, of_default, 50.0)
    found = sweep_of(read_results(folder))
    assert found.highest is found.arms[0]
    assert found.best is found.arms[0 if spread is None else 1]
    words = sweep_verdict(found)
    assert ("a tie with it" in words) == (spread is not None)
    if spread is not None:
        assert "best by ADD(-S): particles 25 (0.900, 50 ms); that is the default" in words
        assert f"a tie with it: particles 5 ({right / 20:.3f}, 30 ms), {spread}" in words


def test_arms_on_other_frames_are_not_compared(sweep: Path) -> None:
    manifest = json.loads((sweep / "0" / "manifest.json").read_text())
    manifest["data"]["frames"] = "others"
    (sweep / "0" / "manifest.json").write_text(json.dumps(manifest))
    found = sweep_of(read_results(sweep))
    assert found.difference(found.arms[0]) is None
    assert found.best is None


@pytest.mark.parametrize(
    ("swept", "panels"), [([PARTICLES], 3), ([PARTICLES, "seed"], 2), ([PARTICLES, "seed", "x"], 2)]
)
def test_every_sweep_is_drawn(tmp_path: Path, swept: list[str], panels: int) -> None:
    folder = write_sweep(tmp_path / "sweep", swept, [])
    for number, value in enumerate(("5", "25")):
        chosen = {key: value if key == PARTICLES else "1" for key in swept}
        write_arm(folder / str(number), chosen, 10 + number, 30.0)
    figure = sweep_figure(sweep_of(read_results(folder)))
    assert figure is not None and len(figure.axes) == panels
    written = {path.name for path in write_sweep_files(folder)}
    assert written == {"sweep.md", "sweep.csv", "sweep.png", "sweep.svg"}
    assert all((folder / name).stat().st_size for name in written)


def test_a_sweep_without_any_result_still_has_its_table(sweep: Path) -> None:
    for arm in "01":
        (sweep / arm / "manifest.json").unlink()
    assert [path.name for path in write_sweep_files(sweep)] == ["sweep.md", "sweep.csv"]
    assert "0 of 3 arms finished" in describe_sweep(sweep, "text")


def test_a_sweep_of_studies_has_no_table(tmp_path: Path) -> None:
    folder = write_sweep(tmp_path / "sweep", ["seed"], ["seed=1,2"])
    (write_run(folder / "0", "demo", {}) / "summary.json").unlink()
    assert describe_sweep(folder, "text") == ""
    assert write_sweep_files(folder) == []


def test_the_pages_of_a_sweep_and_of_its_arms(sweep: Path) -> None:
    pages = write_pages(sweep)
    assert [page.parent for page in pages] == [sweep / "0", sweep / "1", sweep]
    text = pages[-1].read_text()
    assert 'href="0/report.html"' in text and 'href="2/report.html"' not in text
    assert "best by ADD(-S): particles 25" in text
    assert "<script src" not in text and "http://www.w3.org/2000/svg" in text


def test_the_page_shows_the_figure_and_the_front(sweep: Path) -> None:
    write_sweep_files(sweep)
    text = write_pages(sweep)[-1].read_text()
    (picture,) = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', text)
    assert base64.b64decode(picture) == (sweep / "sweep.svg").read_bytes()
    # Both arms are on the front: 12 of 20 in 30 ms, 18 of 20 in 50 ms.
    (front,) = re.findall(r"<[^>]*stroke-dasharray[^>]*>(?:<title>Pareto front</title>)?", text)
    assert "Pareto front" in front and front.count(" ") >= 6
