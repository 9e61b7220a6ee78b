"""Every `hlp` command of README and the pages runs as it is written, in a reader's folder, small.

The folder holds what the commands name: meshes, frames, finished runs, a data set. Settings that
make learning tiny are appended. What cannot run is listed with the reason; test_commands.py
composes it, as all others. Commands that use each other's output are one group, with one folder.
"""

import json
import shutil
from collections.abc import Iterable
from pathlib import Path

import pytest
from markdown_pages import EXAMPLES, commands, write_files
from recording_folders import ONLY, write_recordings
from sequence_folders import write_linemod, write_ycbineoat

from bop_folder import write_models, write_scene
from forked_hlp import Running
from frame_files import write_camera, write_image
from hlp.data.synthetic.objects import demo_objects
from hlp.data.synthetic.scenes import SyntheticScenes, SyntheticSettings
from run_files import logged_runs
from tiny_method import export_mesh
from tiny_run import TINY, TinyRun

NETWORK = "gigabytes from a server; tests/data/test_download.py has one of its own"
CAMERA = "a camera of Intel's; tests/integration/test_live.py has a simulated one"
NOT_RUN = {
    NETWORK: ["download lmo", "download tudl", "download voc2012 output=/data/voc"],
    "seven data sets; tests/integration/test_bop_sweep.py has small ones": [
        "-m experiment=bop data_folder=data",
        "-m experiment=bop data_folder=data data.search=all",
    ],
    CAMERA: ["live source=realsense learnt=learnt/ objects=bracket overlay=last.jpg"],
    "a server of MLflow's; tests/reporting/mlflow/test_mlflow_upload.py has one that is away": [
        "run reporting.uri=http://mlflow.example.org:5000 reporting.experiment=brackets"
    ],
    "serves until it is stopped": ["ui"],
    "a cluster; tests/integration/test_sweep_runs.py looks at what it would be told": [
        "-m hydra/launcher=slurm hydra.launcher.partition=NAME seed=0,1"
    ],
    "processes of its own, which a forked one cannot begin; tests/integration does": [
        "-m hydra/launcher=cores machine.threads=1 seed=0,1",
        "run executor=loky executor.workers=4",
    ],
    "everything is learnt again for each of 39 steps": ["-m experiment=ladder"],
}
"""Commands that are not run, by what they need. test_commands.py composes them."""

MINUTES = (
    "bench",
    "search",
    "run experiment=basin",
    "-m experiment=basin",
    "run warm_start.manifest=",
    "-m refinement=pso,icp",
    "-m experiment=recordings",
    "-m experiment=fig9a method=",
    "-m experiment=fig9b ",
    "-m experiment=ladder ",
    "report experiment=",
)
"""How commands begin that take half a minute or more each, even when they are made small."""
PLACEHOLDERS = {
    "data.root=/path/to/set": "data.root=set",
    "data=/path/to/set": "data=set",
    "data.root=data/lmo": "data.root=set",
    "data.photographs=/data/voc/VOCdevkit/VOC2012/JPEGImages": "data.photographs=photos",
    "data.root=/path/to/linemod": "data.root=linemod",
    "data.root=/path/to/mustard0": "data.root=mustard0",
    "data.mesh=/path/to/mustard.obj": "data.mesh=model.ply",
    "objects=[ape,can,duck]": "objects=[bowl,drill,duck]",
    "page=8000": "page=0",
    "data.root=../shared/data/lm": "data.root=recordings/lm",
    "data.root=/path/to/lm": "data.root=recordings/lm",
    "data_folder=../shared/data": "data_folder=recordings",
    "data_folder=/path/to/sets": "data_folder=recordings",
}
"""Words of commands that stand for the reader's own, and what stands here."""

ORDER = ("learn", "run", "-m", "objects", "predict", "doctor", "live", "upload")
"""Commands of which others show or use what they leave; the others come last."""

GROUPS = ("data sets", "demo", "own objects")
"""Commands of different groups need nothing of each other: each group is a test of its own."""
OWN_OBJECTS = ("learn", "objects", "predict", "doctor", "live")
TINY_METHOD = tuple(key for key in TINY if not key.startswith(("data.", "frames", "panels")))
OWN_DATA = ("data=", "data.root=", "data_folder=")
ONCE = ("frames=1", "timing_frames=1", "panels=0")
SMALLER = {
    "encoder.epochs": "1",
    "frames": "2",
    "patches.pool.per_object": "60",
    "task.trials": "2",
}
"""Values of keys that a command gives, in place of its own."""
ALSO = {
    "learn": [*TINY_METHOD],
    "learn mesh=bracket.ply photographs=photos/ rooms=rooms/": [*TINY_METHOD, "work=cache"],
    "live source=folder learnt=learnt/ rgb=rgb/ depth=depth/ intrinsics=camera.json page=8000": [
        "idle_s=1"
    ],
    "search task.limit_ms=300": ["task.trials=2"],
    "-m experiment=anytime": ["refinement.budget_ms=null,5"],
    "run data=linemod data.root=/path/to/linemod": ["data.only=[ape]"],
}
"""What is appended to a command, or to all of one name, beside the tiny settings."""


VENDOR = """
import cv2
import numpy as np

class Device:
    def __init__(self):
        self.left = 2

    def read(self):
        if self.left == 0:
            raise KeyboardInterrupt  # the reader presses Ctrl-C
        self.left -= 1
        depth = np.full((480, 640), 900, np.uint16)
        return np.zeros((480, 640, 3), np.uint8), depth

    def stop(self):
        pass
"""
"""What the page's own camera takes its images from."""

ENDS = {
    "upload": (1, "nothing to send"),
    "live source=my_camera.py:MyCamera learnt=learnt/": (130, "interrupted"),
    "doctor data=/path/to/set output=look/": (1, "no single known fault explains it"),  # noise
}
"""Commands that end with another code than 0 here, and what they say."""


def written_commands() -> list[list[str]]:
    """Each command once, those that others need first."""
    found = {" ".join(words): words for path in EXAMPLES for words in commands(path)}
    rank = {name: place for place, name in enumerate(ORDER)}
    return sorted(found.values(), key=lambda words: rank.get(words[0], len(ORDER)))


def group(words: list[str]) -> str:
    """Which of `GROUPS` a command belongs to."""
    if words[0] in OWN_OBJECTS:
        return "own objects"
    named = any(word.startswith(OWN_DATA) or "linemod_bop" in word for word in words)
    return "data sets" if named else "demo"


def as_run(words: list[str], folder: Path) -> list[str]:
    """The command with the folder's own names, and with what is appended."""
    given = [PLACEHOLDERS.get(word, word) for word in words]
    if "runs=[RUN_A,RUN_B]" in given:
        given[given.index("runs=[RUN_A,RUN_B]")] = f"runs=[{','.join(runs_of_demo(folder))}]"
    also = ALSO.get(" ".join(words), []) or ALSO.get(words[0], [])
    if "experiment=fig9a" in words and words[0] == "-m":
        also = ["encoder.dimension=100,200"]  # the tiny encoder has no 600 components
    if words[0] not in ("run", "-m", "bench", "search") or words[-1].startswith("manifest="):
        return [*given, *also]
    own_data = any(word.startswith(OWN_DATA) for word in words)
    if "data.root=recordings/lm" in given:
        given = [*(word for word in given if not word.startswith("data.only=")), ONLY]
    size = [] if own_data else [key for key in TINY if key.startswith("data.")]
    chosen = {word.partition("=")[0] for word in words}
    if "encoder.epochs" in chosen:
        chosen.add("encoder")
    if {"experiment=ladder", "method=paper_literal"} & {*words}:  # voting with one hypothesis
        chosen.add("voting.hypotheses")
    own = [key for key in [*size, *TINY_METHOD, *ONCE] if key.partition("=")[0] not in chosen]
    smaller = [f"{key}={SMALLER[key]}" for key in chosen if key in SMALLER]
    return [*given, *dict.fromkeys(own), *smaller, *also]


def runs_of_demo(folder: Path) -> list[str]:
    """Ids of the first and the last of the demo's runs in MLflow's database."""
    client, runs = logged_runs(folder)
    demo = client.get_experiment_by_name("demo").experiment_id
    found = [run.info for run in runs if run.info.experiment_id == demo]
    ids = [info.run_id for info in found if not info.run_name.startswith("sweep")]
    return [ids[0], ids[-1]]


@pytest.fixture
def folder(tmp_path_factory: pytest.TempPathFactory, tiny_run: TinyRun) -> Path:
    """A reader's folder."""
    made = tmp_path_factory.mktemp("reader")
    shutil.copytree(tiny_run.folder / "work", made / "work")
    for name in ("hlp", "seed1", "seed2", "paper", "reference"):
        shutil.copytree(tiny_run.output, made / "outputs" / "linemod_bop" / name)
    for name in ("a", "b"):
        shutil.copytree(tiny_run.output, made / "outputs" / name)
    write_models(made / "set" / "models", (1, 6))
    write_scene(made / "set" / "test")
    write_own_files(made)
    write_recordings(made / "recordings", photographs=made / "photos", room=made / "rooms")
    for path in EXAMPLES:
        write_files(path, made)
    return made


def write_own_files(made: Path) -> None:
    """Meshes of two objects, frames of a camera, photographs and a room without the objects."""
    scenes = SyntheticScenes(SyntheticSettings(scenes=2, seed=3, objects=(5, 5), clutter=(2, 2)))
    for name, model in zip(("bracket.ply", "bolt.stl"), demo_objects().values(), strict=False):
        export_mesh(made / name, model)
    frames = [scenes.load(key) for key in scenes.keys]
    model = demo_objects()[frames[0].targets[0].object_id]
    write_linemod(made / "linemod", model, frames[:1])
    write_ycbineoat(made / "mustard0", model, frames[:1])
    export_mesh(made / "model.ply", model)
    (made / "vendor.py").write_text(VENDOR)
    for room in (made, made / "rooms"):
        for number, frame in enumerate(frames):
            write_image(room, str(number), frame)
        write_camera(room, frames[0])
    shutil.copy(made / "rgb" / "0.png", made / "frame.png")
    shutil.copy(made / "depth" / "0.png", made / "frame_depth.png")
    shutil.copytree(made / "rgb", made / "photos")


def failures(folder: Path, written: Iterable[list[str]], limit: float) -> dict[str, str]:
    """The commands that do not end as they should within seconds, and what they say.

    Commands that are the same where they run, in a reader's own words, run once.
    """
    line = json.dumps({"rgb": "rgb/0.png", "depth": "depth/0.png"}) + "\n"
    failed, seen = {}, set()
    for words in written:
        given = as_run(words, folder)
        if tuple(given) in seen:
            continue
        seen.add(tuple(given))
        ended = Running(folder, *given, stdin=line).wait(limit)
        text = " ".join(words)
        code, said = ENDS.get(text, (0, ""))
        if ended.returncode != code or said not in ended.stdout + ended.stderr:
            failed[text] = (ended.stderr or ended.stdout)[-1000:]
    return failed


def commands_that_run(*, long: bool) -> list[list[str]]:
    """The long or the short ones: a test with both would make CI half as long again."""
    left_out = {text for texts in NOT_RUN.values() for text in texts}
    found = {" ".join(words): words for words in written_commands()}
    return [found[text] for text in found if text not in left_out
            and text.startswith(MINUTES) == long]  # fmt: skip


def assert_all_run(folder: Path, written: Iterable[list[str]], limit: float) -> None:
    failed = failures(folder, written, limit)
    assert not failed, "\n\n".join(f"hlp {words}\n{said}" for words, said in failed.items())


@pytest.mark.minutes
def test_long_commands_run_as_they_are_written(folder: Path) -> None:
    assert_all_run(folder, commands_that_run(long=True), 900.0)


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize("name", GROUPS)
def test_commands_run_as_they_are_written(folder: Path, name: str) -> None:
    written = (words for words in commands_that_run(long=False) if group(words) == name)
    assert_all_run(folder, written, 300.0)
    if name == "own objects":
        assert (folder / "learnt" / "learnt.json").is_file()
        assert (folder / "look").is_dir()


def test_every_exception_stands_in_the_documentation() -> None:
    written = {" ".join(words) for words in written_commands()}
    named = {text for texts in NOT_RUN.values() for text in texts} | {*ENDS}
    assert not (named | {key for key in ALSO if " " in key}) - written
    assert not {*PLACEHOLDERS} - {word for text in written for word in text.split()}
    assert all(any(text.startswith(begin) for text in written) for begin in MINUTES)
