"""What a result was made with: HLP's own source, the libraries behind it, their versions."""

import ast
import hashlib
import platform
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import packages_distributions, version
from importlib.util import find_spec
from pathlib import Path

import hlp

LIBRARIES = (
    "numpy",
    "scipy",
    "numba",
    "onnxruntime",
    "torch",
    "pytorch-lightning",
    "opencv-python-headless",
    "trimesh",
    "pyrender",
    "hydra-core",
    "mlflow",
)


@dataclass(frozen=True)
class Code:
    """The code behind a result: a digest of its source, and the libraries with their versions."""

    source: str
    libraries: dict[str, str]


def library_versions() -> dict[str, str]:
    """Versions of Python, of HLP and of the libraries that decide its numbers."""
    own = {"python": platform.python_version(), "hlp": hlp.__version__}
    return own | {name: version(name) for name in LIBRARIES}


def code_digest() -> str:
    """Digest (16 hex digits) of all of HLP's Python files as they are on disk now."""
    package = Path(hlp.__file__).parent
    digest = hashlib.blake2b(digest_size=8)
    for source in sorted(package.rglob("*.py")):
        digest.update(source.relative_to(package).as_posix().encode() + b"\0")
        digest.update(source.read_bytes() + b"\0")
    return digest.hexdigest()


@cache
def code_of(*modules: str) -> Code:
    """The code of modules: their source and that of all they import from their own packages.

    The packages are HLP, and for a module of a plug-in the plug-in's. Imports are read from the
    source, so those within functions count too. Of other packages the installed version counts.
    Raises ModuleNotFoundError for a module that does not exist.
    """
    packages = {"hlp", *(name.partition(".")[0] for name in modules)}
    sources: dict[str, bytes] = {}
    foreign: set[str] = set()
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        if name in sources:
            continue
        path = _source_file(name)
        if path is None:
            raise ModuleNotFoundError(f"no source of module {name}")
        sources[name] = path.read_bytes()
        for imported in _imports(name, sources[name]):
            if imported.partition(".")[0] not in packages:
                foreign.add(imported.partition(".")[0])
            elif imported not in packages and _source_file(imported) is not None:
                waiting.append(imported)
    digest = hashlib.blake2b(digest_size=8)
    for name, text in sorted(sources.items()):
        digest.update(name.encode() + b"\0" + text + b"\0")
    return Code(digest.hexdigest(), _versions(foreign))


def _imports(module: str, source: bytes) -> Iterable[str]:
    """Full names of all that a module's source imports, modules or not."""
    for node in ast.walk(ast.parse(source, module)):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{each.name}" for each in node.names)


@cache
def _source_file(module: str) -> Path | None:
    """A module's Python file; None where the name is no module's."""
    try:
        spec = find_spec(module)
    except (ModuleNotFoundError, ValueError):
        return None
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        return None
    return Path(spec.origin)


def _versions(modules: Iterable[str]) -> dict[str, str]:
    """Versions of the distributions that bring modules, and Python's for its own library."""
    brought_by = _distributions()
    names = {name for module in modules for name in brought_by.get(module, ())}
    found = {name: version(name) for name in sorted(names)}
    return {"python": ".".join(map(str, sys.version_info[:2])), **found}


@cache
def _distributions() -> dict[str, list[str]]:
    return dict(packages_distributions())


def git_revision() -> str | None:
    """Commit of the checkout that HLP runs from, `+` behind it where files were changed since.

    None for an installed package, wherever it lies, and where there is no git.
    """
    package = Path(hlp.__file__).parent

    def git(*words: str) -> str | None:
        try:
            done = subprocess.run(["git", *words], cwd=package, capture_output=True, text=True)
        except OSError:
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    if git("ls-files", "--error-unmatch", "__init__.py") is None:
        return None
    changed = git("status", "--porcelain", "--untracked-files=no", "--", ".")
    return f"{git('rev-parse', 'HEAD')}{'+' if changed else ''}"
