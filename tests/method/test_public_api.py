"""What `hlp` exports: examples in its docstrings, and what it prints."""

import doctest
import json
import shutil
import typing
from types import FunctionType

import numpy as np
import pytest

import hlp

NO_EXAMPLE = {"Frame", "ObjectModel", "Detector.objects", "Detector.threads"}
"""What other examples show: one is loaded or made by HLP, the properties are single values."""


def public(name):
    """A class of ours with all that it inherits."""
    return [kind for kind in getattr(hlp, name).__mro__[::-1] if "hlp." in kind.__module__]


def examples():
    finder = doctest.DocTestFinder(exclude_empty=True)
    kinds = [(kind, name) for name in hlp.__all__ for kind in public(name)]
    found = [test for kind, name in kinds for test in finder.find(kind, name)]
    return {test.name: test for test in found if test.examples}


@pytest.mark.parametrize("name", examples())
def test_examples_of_docstrings_run(name, learnt, frame, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(learnt, "learnt")
    image = hlp.CameraImage(frame.rgb, frame.depth, frame.camera_matrix)
    test = examples()[name]
    detector = hlp.Detector.load("learnt")
    given = {"Detector": hlp.Detector, "detector": detector, "image": image, "json": json}
    test.globs |= vars(image) | given
    options = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    report = list[str]()
    doctest.DocTestRunner(optionflags=options).run(test, out=report.append)
    assert not report, "".join(report)


def methods(of):
    """What has a name without underscore, by it."""
    every = [item for kind in public(of) for item in vars(kind).items() if item[0][0] != "_"]
    return {f"{of}.{name}": getattr(value, "__func__", value) for name, value in every}


def test_what_is_public_is_documented_with_arguments_results_and_an_example():
    assert {*hlp.__all__, *methods("Detector")} - examples().keys() == NO_EXAMPLE
    for name, method in (methods("Detector") | methods("Tracker")).items():
        if isinstance(method, FunctionType):
            hints = typing.get_type_hints(method)
            gives = hints.pop("return") is not type(None)
            assert ("Args:" in method.__doc__, "Returns:" in method.__doc__) == (bool(hints), gives)
            assert all(f"    {argument}: " in method.__doc__ for argument in hints), name


def test_all_of_a_public_signature_is_exported():
    exported = [getattr(hlp, name) for name in hlp.__all__]
    classes = [value for value in exported if isinstance(value, type)]
    signatures = [
        typing.get_type_hints(method)
        for of in (*hlp.Detector.__mro__[:-1], hlp.Tracker)
        for name, method in vars(of).items()
        if isinstance(method, FunctionType) and not name.startswith("_")
    ]
    fields = [typing.get_type_hints(of) for of in (hlp.Detection, hlp.SearchResult)]
    named = {one for hints in signatures + fields for hint in hints.values() for one in parts(hint)}
    assert named and named <= {*classes}


def parts(hint):
    """HLP's classes in a type hint."""
    own = isinstance(hint, type) and getattr(hint, "__module__", "").startswith("hlp.")
    inner = [parts(part) for part in typing.get_args(hint)]
    return set().union(*inner, {hint} if own else set())


def test_what_is_printed_and_what_goes_to_json(learnt, frame):
    detector = hlp.Detector.load(learnt, threads=1)
    assert repr(detector) == (
        f"Detector({str(learnt)!r}, objects=['bear', 'can'], encoder=pca, codebook=exact, "
        "refinement=pso, threads=1)"
    )
    fit = hlp.PoseFit(0.1, 0.5, 0.5, np.inf, 0.9)
    pose = np.diag([1.0, 1.0, 1.0, 1.0])
    pose[:3, 3] = 0.0123, -0.05, 0.7
    other = hlp.RunnerUp(pose, 0.25)
    found = hlp.Detection("bear", 0.875, pose, 0.9, 1.0, np.inf, pose[None], other, fit)
    assert str(found) == "bear: score 0.88 at (12.3, -50.0, 700.0) mm, 90% visible"
    read = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert read["object"] == "bear"
    assert read["residual_mm"] is None and read["fit"]["residual_mm"] is None
    assert read["runner_up"] == {"pose_cam_obj": pose.tolist(), "score": 0.25}
    assert read["equivalent_poses"] == [pose.tolist()]
