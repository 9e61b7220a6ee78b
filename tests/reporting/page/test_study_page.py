"""Pages of studies, written by hand as a study leaves its folder."""

import json
from pathlib import Path

import pytest

from hlp.errors import DataError
from hlp.reporting.page import page_or_log
from hlp.reporting.page.pages import study_folders, write_study_page
from hlp.reporting.report import report_runs, write_pages

TABLE = """\
Recall of <b>2</b> frames.

| object   |   recall |
|:---------|---------:|
| <cat>    |     0.50 |
"""


def write_study(folder: Path, name: str = "basin") -> Path:
    folder.mkdir(parents=True)
    config = {"name": "demo", "task": {"name": name}, "data": {"name": "synthetic"}}
    (folder / "manifest.json").write_text(json.dumps({"config": config, "hlp": "1"}))
    (folder / f"{name}.md").write_text(TABLE)
    (folder / ".hydra").mkdir()
    (folder / ".hydra" / "overrides.yaml").write_text(f"- task={name}\n- output=x\n- seed=2\n")
    return folder


def test_the_page_has_tables_figures_and_the_command(tmp_path: Path) -> None:
    folder = write_study(tmp_path / "study")
    (folder / "heatmaps").mkdir()
    for name in ("a_cup", "all"):
        (folder / "heatmaps" / f"{name}.svg").write_text("<svg/>")
    page = write_study_page(folder)
    text = page.read_text()
    assert page == folder / "report.html" and "basin study on data=synthetic" in text
    assert ">&lt;cat&gt;</td>" in text and "<b>2</b>" not in text  # shown, not run
    assert text.index("<summary>all</summary>") < text.index("<summary>a cup</summary>")
    assert "hlp run task=basin seed=2" in text and "http" not in text
    assert "name: demo" in text and "&#34;hlp&#34;: &#34;1&#34;" in text


def test_pages_of_all_studies_in_a_folder_are_written(tmp_path: Path) -> None:
    first, second = write_study(tmp_path / "a", "oracle"), write_study(tmp_path / "b" / "c")
    whole = write_study(tmp_path / "run")
    (whole / "summary.json").write_text("{}")  # a run of the whole method is no study
    (write_study(tmp_path / "none") / "basin.md").unlink()
    for number, content in enumerate(("[]", "{}", '{"config": {"task": 1}}')):  # somebody else's
        other = write_study(tmp_path / "others" / str(number))
        (other / "manifest.json").write_text(content)
        with pytest.raises(DataError, match=r"names no config\.task"):
            write_study_page(other)
    assert study_folders(tmp_path) == [first, second]
    (whole / "summary.json").unlink()
    (whole / "manifest.json").unlink()
    assert write_pages(tmp_path) == [first / "report.html", second / "report.html"]
    assert write_pages(first) == [first / "report.html"]


def test_the_report_names_studies_and_prints_their_tables_as_markdown(tmp_path: Path) -> None:
    study = write_study(tmp_path / "s")
    assert " ".join(report_runs(tmp_path, "text").split()) == f"Study: {study} (basin.md)"
    printed = report_runs(study, "markdown")
    assert printed == f"## {study}\n\n{TABLE}"


def test_a_broken_manifest_costs_the_page_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write_study(tmp_path / "study")
    (folder / "manifest.json").write_text("{")
    with pytest.raises(DataError, match=r"manifest\.json"):
        write_study_page(folder)
    assert page_or_log(write_study_page, folder) is None
    assert f"the report of {folder} could not be written" in caplog.text
    assert not (folder / "report.html").exists()
