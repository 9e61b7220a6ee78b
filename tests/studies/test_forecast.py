"""What is said of a sweep over data sets before its first run and after each."""

import json
import logging
import shutil
import time
from collections import namedtuple
from itertools import count

from omegaconf import OmegaConf

from bop_sets import write_bop_set
from hlp.studies import sweep
from hlp.studies.forecast import say_forecast


def test_counts_hours_and_disk_are_said_before_and_after_runs(tmp_path, caplog, monkeypatch):
    caplog.set_level(logging.INFO, "hlp")
    for name in ("lmo", "itodd"):  # the others are absent
        write_bop_set(name, tmp_path / "sets" / name, width=160)
    roots = ",".join("${data_folder}/" + name for name in ("lmo", "tless", "itodd"))
    config = OmegaConf.create({
        "data_folder": str(tmp_path / "sets"),
        "frames": None,
        "data": {"name": "bop", "root": "???", "split": "test"},
        "hydra": {"sweeper": {"params": {"data.root": roots}}, "overrides": {"task": []}},
    })  # fmt: skip
    clock = count(step=0.125)
    monkeypatch.setattr(time, "perf_counter", lambda: next(clock))
    extents = sweep._extents(config, sweep._swept(config))
    lmo, itodd = (str(tmp_path / "sets" / name) for name in ("lmo", "itodd"))
    assert [(e.root, e.counts[:2]) for e in extents] == [(lmo, (2, 3)), (itodd, (2, 3))]
    assert all(extent.seconds > 0 for extent in extents)
    assert f"searching 3 images of {lmo}, to tell how long it will take" in caplog.text
    config.data.search, config.frames = "all", 2
    assert [e.counts for e in sweep._extents(config, sweep._swept(config))] == [(2, 2, 4)] * 2
    extents = json.loads(json.dumps([(lmo, (8, 200, 1000), 0.25), (itodd, (28, 721, 3000), 0.5)]))
    folder, work = tmp_path / "out", tmp_path / "work"
    say_forecast(extents, folder, work)
    assert "58 s to learn an object, as the demo's on two cores; searches as timed" in caplog.text
    lines = [line.split() for line in caplog.text.splitlines()]
    assert ["lmo", "8", "200", "1,000", "0:08", "0:04", "0.8", "GB"] in lines
    assert ["all", "36", "921", "4,000", "0:35", "0:29", "3.6", "GB"] in lines
    made = [("classifier", 160.0), ("regions", 500.0), ("hypotheses", 500.0), ("poses", 500.0)]
    stages = [{"stage": stage, "fingerprint": "0" * 16, "seconds": s} for stage, s in made] * 2
    (folder / "0").mkdir(parents=True)
    (folder / "1").mkdir()
    manifest = {"config": {"data": {"root": lmo}}, "stages": stages}
    (folder / "0" / "manifest.json").write_text(json.dumps(manifest))
    (folder / "1" / "manifest.json").write_text("damaged")
    for stage, _ in made:
        (work / stage / ("0" * 16)).mkdir(parents=True)
        (work / stage / ("0" * 16) / "made.npy").write_bytes(bytes(1000))
    caplog.clear()
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(1, 1, 10_000))
    say_forecast(extents, folder, work)
    assert "20 s to learn an object, as in 1 finished; searches as timed" in caplog.text
    assert "of each set, × 2 as in what is finished." in caplog.text
    lines = [line.split() for line in caplog.text.splitlines()]
    assert ["all", "28", "721", "3,000", "0:09", "0:50", "0.0", "GB"] in lines
    assert "0.0 GB free, about 0.0 are needed: free some" in caplog.text
    caplog.clear()
    say_forecast(extents[:1], folder, work)
    assert not caplog.text
