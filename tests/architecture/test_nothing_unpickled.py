"""No file is read in a way that could run code of whoever wrote it."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import hlp

SOURCES = sorted(Path(hlp.__file__).parent.rglob("*.py"))
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


def unsafe(source: str) -> list[str]:
    """Calls that may run code from a file."""
    found = []
    for name, call in calls(source):
        arguments = {f"{each.arg}={ast.unparse(each.value)}" for each in call.keywords}
        if name in FORBIDDEN or (name in SAFE and SAFE[name] not in arguments):
            found.append(f"{name}, line {call.lineno}")
        if "shell=True" in arguments:
            found.append(f"a shell, line {call.lineno}")
    return found


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
    assert len(unsafe(source)) == 1


def test_no_module_does_any_of_it() -> None:
    found = {str(path): unsafe(path.read_text(encoding="utf-8")) for path in SOURCES}
    assert len(found) > 200
    assert {path: lines for path, lines in found.items() if lines} == {}


def test_files_that_are_memory_mapped_or_read_by_numpy_are_found_at_all() -> None:
    names = {name for path in SOURCES for name, _ in calls(path.read_text(encoding="utf-8"))}
    assert SAFE.keys() <= names
