import csv
import json
import zipfile

from hlp.reporting.bop_table import bop_runs, bop_table, write_server_files
from hlp.reporting.experiments import write_reports
from hlp.reporting.results import read_result
from hlp.reporting.sweep_report import write_sweep as write_sweep_files
from hlp.reporting.sweeps import read_sweeps
from written_results import summary, write_run, write_sweep


def run(folder, name, search="targets", split="test", **found):
    """A run of a set; its poses are one line."""
    data = {"root": f"/sets/{name}", "search": search, "split": split}
    written = write_run(folder, "bop", summary() | found, [f"data.root=/sets/{name}"], data=data)
    (written / "poses.csv").write_text(
        f"scene_id,im_id,obj_id,score,R,t,time\n1,2,3,.5,R,{name},-1\n"
    )
    return written


def private(written, **found):
    """The run as it is where true poses are private: with its times alone."""
    (written / "summary.json").unlink()
    timing = {**summary()["timing"], "frames": 2, "objects": 6, "wall_ms": 100.0, **found}
    (written / "timing.json").write_text(json.dumps(timing))
    return written


def test_sets_stand_beside_their_mean_and_published_methods(tmp_path):
    timing = summary()["timing"] | {"frames": 2, "objects": 6, "wall_ms": 500.0, "cpu_ms": 400.0}
    recalls = {"vsd": 0.5, "mssd": 0.7, "mspd": 0.6}
    precision = {"ap": 0.4, "mssd": 0.3, "mspd": 0.5, "mssd_mm": 0.2}
    folders = [
        run(tmp_path / "0", "lmo", bop={"ar": 0.6, **recalls}, timing=timing),
        run(tmp_path / "1", "tless", bop={"ar": 0.4, **recalls}, timing=timing),
        run(tmp_path / "2", "lmo", "all", detection=precision, timing=timing),
    ]
    table = bop_table([read_result(folder) for folder in folders])
    rows = [dict(zip(table.header, row, strict=True)) for row in table.rows]
    assert [row["set"] for row in rows[:4]] == ["lmo", "tless", "mean, localization", "lmo"]
    assert [row["AR"] for row in rows[:4]] == ["0.600", "0.400", "0.500", ""]
    assert [row["AP"] for row in rows[:4]] == ["", "", "", "0.400"]
    assert rows[3]["AP mm"] == "0.200"
    assert {(row["s"], row["CPU s"]) for row in rows[:4]} == {("1.5", "1.2")}
    vidal = next(row for row in rows if row["set"].startswith("Vidal"))
    assert (vidal["AR"], vidal["s"], vidal["on"]) == ("0.569", "3.2", "CPU")


def test_sets_with_private_true_poses_have_their_seconds_and_no_part_in_the_mean_accuracy(tmp_path):
    folder = write_sweep(tmp_path / "sweep", ["data.root"], ["experiment=bop"])
    private(run(folder / "0", "itodd"))
    private(run(folder / "1", "hb"), wall_ms=300.0)
    times = {
        path.name for sweep in read_sweeps(folder) for path in write_sweep_files(folder, sweep)
    }
    assert {"times.md", "times.csv", "times.svg"} <= times
    assert {"bop.csv", "hlp_itodd-test.csv", "hlp_bop.zip"} <= {
        path.name for path in write_reports(folder)
    }
    with (folder / "bop.csv").open() as stream:
        rows = list(csv.DictReader(stream))[:3]
    assert [(row["set"], row["AR"], row["s"]) for row in rows] == [
        ("itodd", "", "0.3"),
        ("hb", "", "0.9"),
        ("mean, localization", "", "0.6"),
    ]
    run(folder / "2", "lmo", bop={"ar": 0.0, "vsd": 0.0, "mssd": 0.0, "mspd": 0.0})
    run(folder / "3", "tudl", bop={"ar": 0.5, "vsd": 0.5, "mssd": 0.5, "mspd": 0.5})
    mean = next(row for row in bop_table(bop_runs(folder)).rows if row[0].startswith("mean"))
    assert mean[:3] == ["mean, localization", "4", "0.250"]


def test_poses_of_all_runs_are_packed_under_the_names_that_the_server_wants(tmp_path):
    folder = write_sweep(tmp_path / "sweep", ["data.root"], [])
    run(folder / "0", "lmo")
    run(folder / "1", "ycbv", "all")
    private(run(folder / "2", "itodd", split="test_primesense"))
    run(folder / "3", "hb", split="val_primesense")
    unfinished = run(folder / "4", "tudl")
    (unfinished / "manifest.json").unlink()
    names = ["hlp_lmo-test", "hlp-detection_ycbv-test", "hlp_itodd-test", "hlp_hb-val"]
    written = [f"{name}.csv" for name in names]
    assert [path.name for path in write_server_files(folder)] == [*written, "hlp_bop.zip"]
    lines = (folder / "hlp_itodd-test.csv").read_text().splitlines()
    assert lines[1:] == ["1,2,3,.5,R,itodd,0.3"]  # no time is known: it is the mean
    with zipfile.ZipFile(folder / "hlp_bop.zip") as packed:
        assert packed.namelist() == written
    reports = {path.name for path in write_reports(folder)}
    assert {"bop.md", "bop.csv", *written, "hlp_bop.zip"} <= reports
    assert write_server_files(tmp_path) == []
