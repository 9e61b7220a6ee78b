"""Pages of runs, and of studies, written by hand as a study leaves its folder."""

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from box_scene import at, box_model
from hlp.errors import DataError
from hlp.records import Frame, Target, TargetScore
from hlp.reporting.page import page_or_log, study_folders, write_run_page, write_study_page
from hlp.reporting.page.report_data import ReportData, Scene, keep_target, picture_path, wires_of
from hlp.reporting.report import report_runs, write_pages
from hlp.results.poses_file import write_scores
from written_results import summary, write_run


def target(frame: int, right: bool, found: bool = True, **changes: Any) -> TargetScore:
    values: dict[str, Any] = {
        "visible_fraction": 0.5, "add_error": 0.002, "rotation_error": 0.1,
        "translation_error": 0.003, "box_iou": 0.9, "cause": "" if right else "few_votes",
        "score": 0.8,
    } | changes  # fmt: skip
    verdicts = {"add_correct": right, "pose_correct": right, "box_correct": right}
    return TargetScore(1, frame, 6, found, **(values | verdicts))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    folder = write_run(tmp_path / "run", "demo", summary(("<cat>",)), ["seed=3", "name=a b"])
    lost = target(
        8, False, found=False, add_error=np.inf, rotation_error=np.inf, translation_error=np.inf
    )
    scores = [target(7, True), lost, target(9, False)]
    write_scores(folder / "scores.csv", scores, {6: "<cat>"})
    return folder


def keep(run: Path, *frames: int) -> None:
    """Material of the object in some frames, which show two points near it and one far away."""
    depth = np.zeros((120, 160))
    depth[60, 80], depth[61, 80], depth[0, 0] = 0.8, 0.85, 2.0
    pose = at(0.0, 0.0, 0.8)
    camera = np.array([[100.0, 0.0, 80.0], [0.0, 100.0, 60.0], [0.0, 0.0, 1.0]])
    model = replace(box_model(), name="<cat>")
    targets = []
    for frame in frames:
        shot = Frame(1, frame, np.full((120, 160, 3), 90, dtype=np.uint8), depth, camera)
        seen: Any = SimpleNamespace(frame=shot, model=model, truth=Target(6, pose), pose=None)
        targets.append(keep_target(run, (1, frame, 6, 0), shot.rgb, seen))
    ReportData({model.name: wires_of(model)}, targets).write(run)


class Page(HTMLParser):
    """Which addresses a page names, and its data."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.elements: list[str] = []
        self.text = path.read_text()
        self.feed(self.text)
        found = re.search(r'type="application/json">(.*?)</script>', self.text, re.S)
        self.data: dict[str, Any] = json.loads(found[1]) if found else {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append(tag)
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href")]


def test_the_page_stands_alone_and_says_what_was_found(run: Path) -> None:
    page = Page(write_run_page(run))
    addresses = {address for address in page.addresses if not address.startswith("#")}
    assert all(address.startswith("data:image/svg+xml;base64,") for address in addresses)
    assert "url(" not in page.text and "import " not in page.text.lower().split("<script")[0]
    assert "cat" not in page.elements  # names are escaped
    assert "4 of 8 targets have a right pose" in page.text
    assert "hlp run seed=3 &#39;name=a b&#39;" in page.text


def test_every_target_has_its_row_and_missing_numbers_are_none(run: Path) -> None:
    rows = Page(write_run_page(run)).data["rows"]
    assert [row[1] for row in rows] == [7, 8, 9]
    assert [row[4] for row in rows] == ["right", "not found", "wrong"]
    assert rows[0][6:9] == [0.5, 2.0, pytest.approx(5.73, abs=0.01)]
    assert rows[1][7:10] == [None, None, None]


def test_pictures_and_scenes_are_in_the_page(run: Path) -> None:
    keep(run, 8, 9)
    page = Page(write_run_page(run))
    assert set(page.data["pictures"]) == {"1_8_6_0", "1_9_6_0"}
    assert [row[3] for row in page.data["rows"]] == ["1_7_6_0", "1_8_6_0", "1_9_6_0"]
    scene = page.data["scenes"]["targets"]["1_8_6_0"]
    assert scene["truth"][3::4] == [0.0, 0.0, 800.0, 1.0] and scene["estimate"] is None
    points = np.frombuffer(base64.b64decode(scene["points"]), "<i2").reshape(-1, 3)
    assert points.tolist() == [[0, 0, 0], [0, 85, 500]]  # tenths of a millimetre
    edges = page.data["scenes"]["models"]["<cat>"]["edges"]
    assert len(edges) == 18 and all(first < second for first, second in edges)  # of a box
    assert "Recall by threshold" in page.text


@pytest.mark.parametrize(("kept", "shown"), [((8, 9), "1_8_6_0"), ((7, 9), "1_9_6_0")])
def test_where_there_is_no_room_for_all_pictures_those_of_misses_are_shown(
    run: Path, monkeypatch: pytest.MonkeyPatch, kept: tuple[int, int], shown: str
) -> None:
    keep(run, *kept)  # 7 is right
    size = (run / "report" / f"000001_{kept[0]:06d}_6_0.jpg").stat().st_size
    monkeypatch.setattr("hlp.reporting.page._MOST_BYTES", size)
    page = Page(write_run_page(run))
    assert list(page.data["pictures"]) == [shown]
    assert "1 more pictures lie in report/" in page.text


def test_misses_are_counted_by_object_and_by_visible_fraction(run: Path) -> None:
    text = Page(write_run_page(run)).text
    begun = text.index("by object and by visible fraction")
    shown = re.sub(r"<[^>]+>", " ", text[begun : text.index("</details>", begun)]).split()
    assert shown[:3] and "0.6-1" in shown and shown.count("all") == 2


def test_pictures_of_the_stages_are_shown_in_their_order(run: Path) -> None:
    assert "What each stage works with" not in Page(write_run_page(run)).text
    (run / "stages").mkdir()
    for name in ("swarm_costs", "views", "of_another_version"):
        (run / "stages" / f"{name}.jpg").write_bytes(name.encode())
    (run / "panels").mkdir()
    for name in ("000001_000007_poses", "000001_000007_cat"):
        (run / "panels" / f"{name}.jpg").write_bytes(name.encode())
    page = Page(write_run_page(run))
    files = ("000001_000007_poses", "views", "swarm_costs")  # frames come first
    drawn = [base64.b64encode(name.encode()).decode() for name in files]
    photographs = [address for address in page.addresses if "jpeg" in address]
    assert photographs == [f"data:image/jpeg;base64,{picture}" for picture in drawn]
    assert "What each stage works with" in page.text


def named(picture: str) -> Scene:
    return Scene((1, 2, 3, 0), picture, [0.0] * 3, "", "", [0.0] * 16, None)


@pytest.mark.parametrize("name", ["../outside.jpg", "..", "{report}/picture.jpg"])
def test_a_picture_outside_of_the_runs_own_folder_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(DataError, match="names a file outside"):
        picture_path(tmp_path, named(name.format(report=tmp_path / "report")))


def test_only_pictures_are_taken(tmp_path: Path) -> None:
    (tmp_path / "report").mkdir()
    for name, content in (("picture.jpg", b"\xff\xd8\xff\xe0rest"), ("text.jpg", b"of the user")):
        (tmp_path / "report" / name).write_bytes(content)
    found = [picture_path(tmp_path, named(f"{n}.jpg")) for n in ("picture", "text", "absent")]
    assert found == [tmp_path / "report" / "picture.jpg", None, None]


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
    assert "hlp run task=basin seed=2" in text and "://" not in text
    assert "default-src 'none'; img-src data:;" in text  # no server is asked for a picture
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
