"""No file is read in a way that could run code of whoever wrote it; progress lines say what for."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import hlp

PACKAGE = Path(hlp.__file__).parent
SAFE = {"np.load": "allow_pickle=False", "torch.load": "weights_only=True"}
FORBIDDEN = {
    *(f"{m}.{f}" for m in ("pickle", "cloudpickle", "marshal", "dill") for f in ("load", "loads")),
    "pickle.Unpickler", "joblib.load", "shelve.open", "yaml.load", "yaml.unsafe_load", "eval",
    "exec", "os.system", "os.popen", "torch.jit.load", "torch.hub.load", "hydra.utils.instantiate",
    "instantiate", "pd.read_pickle", "tarfile.extractall", "cv2.dnn.readNet",
}  # fmt: skip


def calls(source: str) -> Iterator[tuple[str, ast.Call]]:
    """The name and the arguments of each call."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node


@cache
def all_calls() -> list[tuple[str, str, ast.Call]]:
    """Place, name and arguments of each call in the package."""
    return [
        (f"{path.relative_to(PACKAGE)}:{call.lineno}", name, call)
        for path in sorted(PACKAGE.rglob("*.py"))
        for name, call in calls(path.read_text(encoding="utf-8"))
    ]


def is_unsafe(name: str, call: ast.Call) -> bool:
    """Whether it may run code from a file, or starts a shell."""
    given = {f"{argument.arg}={ast.unparse(argument.value)}" for argument in call.keywords}
    unchecked = name in SAFE and SAFE[name] not in given
    return name in FORBIDDEN or unchecked or "shell=True" in given


@pytest.mark.parametrize(
    "source",
    [
        "import pickle\npickle.load(stream)",
        "np.load(path)",
        "np.load(path, allow_pickle=True)",
        "torch.load(path)",
        "subprocess.run(text, shell=True)",
        "hydra.utils.instantiate(config)",
    ],
)
def test_what_is_unsafe_is_seen(source: str) -> None:
    assert [is_unsafe(*found) for found in calls(source)] == [True]


def test_no_module_does_any_of_it() -> None:
    assert [place for place, name, call in all_calls() if is_unsafe(name, call)] == []
    assert SAFE.keys() <= {name for _, name, _ in all_calls()}, "they are not seen at all"


def test_every_progress_line_has_a_purpose_and_is_not_lost_in_a_file() -> None:
    lines = [(place, call) for place, name, call in all_calls() if name == "Progress"]
    assert len(lines) > 10
    for place, call in lines:
        given = {argument.arg for argument in call.keywords}
        assert "desc" in given or len(call.args) > 1, f"{place} does not say what for"
    assert [place for place, name, _ in all_calls() if name == "tqdm"] == []
