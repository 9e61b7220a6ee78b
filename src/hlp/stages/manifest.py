"""What outputs and results are made from: fingerprints, and what `manifest.json` says.

A fingerprint is the name of a stage's output, made from everything that affects its content.
"""

import dataclasses
import hashlib
import json
import platform
import re
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import distribution, version
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Le

import hlp
from hlp.errors import DataError
from hlp.files import read_json
from hlp.fingerprints import Code, code_of, contents_digest
from hlp.settings import NotNegative, Stored, stored_as

# It collects the settings of the whole method. Their values are in each fingerprint already, and
# the code that a stage runs is imported by the stage itself.
_COLLECTS = ("hlp.method.settings",)
_FINGERPRINT = re.compile(r"[0-9a-f]{16}")
LIBRARIES = (
    *("numpy", "scipy", "numba", "onnxruntime", "torch", "pytorch-lightning"),
    *("opencv-python-headless", "trimesh", "pyrender", "hydra-core", "mlflow"),
)
_COMPILED = re.compile(r"\.(so|dylib|pyd|dll)(\.[\d.]+)?$")


def stage_code(*modules: str) -> Code:
    """The code that these modules run, without the code of other stages."""
    return code_of(*sorted(set(modules)), leaving_out=_COLLECTS)


Description = dict[str, Any]
"""Settings, upstream, seed and code of an output: what its name is made of."""


def described(settings: Any, upstream: Mapping[str, str], seed: int, code: Code) -> Description:
    """What `fingerprint` takes, and `stage.json` holds."""
    return {"settings": settings, "upstream": upstream, "seed": seed, "code": code}


def fingerprint(stage: str, description: Mapping[str, Any]) -> str:
    """Digest (16 hex digits) of everything that affects a stage's output.

    That is its `settings` without those that change only the time (paths, threads), `seed`, `code`
    and `upstream`: for each input the fingerprint of the stage that made it, or the identity of the
    data it was read from. Raises as `plain` does.
    """
    identity = plain({"stage": stage, **description})
    text = json.dumps(identity, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def is_fingerprint(text: str) -> bool:
    """Whether a text has the form of a fingerprint, and so is the name of a folder, not a path."""
    return _FINGERPRINT.fullmatch(text) is not None


def plain(value: Any) -> Any:
    """Settings as JSON values: the same for equal settings, different for different ones.

    A dataclass keeps the name of its class, so that two alternatives with equal fields differ.
    Raises TypeError for values that JSON lacks (arrays, sets, functions) and ValueError for NaN,
    which never equals itself.
    """
    return json.loads(json.dumps(value, default=_as_json, allow_nan=False))


def _as_json(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Path):
        return value.as_posix()
    if isinstance(value, Mapping):
        return dict(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return {"class": type(value).__name__, "fields": fields}
    raise TypeError(f"{value!r} is no plain value, as settings are")


MakingTime = Annotated[NotNegative, Le(1e9)]  # seconds


@dataclass(frozen=True)
class StageEvent(Stored):
    """One stage output that a run requested; `seconds` is the time of making it, now or earlier.

    Outputs that were made in one pass over the frames all have the time of the whole pass. `of`
    names the output's object, and is empty for an output of all objects.
    """

    stage: str
    of: str = ""
    fingerprint: str = ""
    reused: bool = False
    seconds: MakingTime = 0.0


def read_manifest(path: Path) -> dict[str, Any]:
    """Read `manifest.json`. Raises MissingFileError, or DataError if it is not a manifest."""
    manifest = read_json(path)
    if not isinstance(manifest, dict) or not isinstance(manifest.get("config"), dict):
        raise DataError(f"{path} is not a manifest of a run: it has no config")
    return manifest


def named_outputs(path: Path) -> list[StageEvent]:
    """Every stage output that a manifest names. Raises DataError if it is damaged."""
    events = stored_as(list[StageEvent], read_manifest(path).get("stages", []), f"{path}, stages")
    for event in events:
        if not is_fingerprint(event.fingerprint):
            wrong = f"{event.fingerprint!r} is not a fingerprint of a stage '{event.stage}'"
            raise DataError(f"{path}: {wrong}")
    return events


def device_name(device: str) -> str:
    """The device that torch or Lightning takes for `device`: `cpu`, or the GPU's model.

    `device` is one of torch or an accelerator of Lightning, whose `auto` depends on the machine. If
    it is a GPU and there is none, it is the name itself.
    """
    if device == "cpu":
        return device
    import torch  # slow to import, and not needed for the CPU

    if torch.cuda.is_available():
        return str(torch.cuda.get_device_name())
    if device == "auto":
        return "mps" if torch.backends.mps.is_available() else "cpu"
    return device


def library_versions() -> dict[str, str]:
    """Versions of Python, of HLP and of the libraries that affect its results."""
    own = {"python": platform.python_version(), "hlp": hlp.__version__}
    return own | {name: version(name) for name in LIBRARIES}


def library_builds() -> dict[str, str]:
    """A digest (16 hex digits) of the compiled files of each library that has some.

    Two builds of one version, as for other processors or with other options, may differ in the last
    bits of their results. The digests are those that installers have recorded; a library that was
    installed without a record is left out.
    """
    builds = {}
    for name in (*LIBRARIES, "llvmlite"):
        files = distribution(name).files or []
        hashes = [f"{f} {f.hash.value}" for f in files if f.hash and _COMPILED.search(f.name)]
        if hashes:
            text = "\n".join(sorted(hashes)).encode()
            builds[name] = hashlib.blake2b(text, digest_size=8).hexdigest()
    return builds


def processor() -> dict[str, str]:
    """The system, the processor's type and its instruction sets, for which kernels are compiled."""
    from llvmlite import binding

    features = binding.get_host_cpu_features()
    return {
        "system": f"{platform.system()} {platform.machine()}",
        "type": str(binding.get_host_cpu_name()),
        "features": " ".join(sorted(name for name, there in features.items() if there)),
    }


def code_digest() -> str:
    """Digest (16 hex digits) of all of HLP's Python files as they are on disk now."""
    package = Path(hlp.__file__).parent
    return contents_digest(
        {path.relative_to(package).as_posix(): path.read_bytes() for path in package.rglob("*.py")}
    )


def git_revision() -> str | None:
    """Commit of the checkout that HLP runs from, followed by `+` if files have been changed since.

    None for an installed package, even inside another checkout, and without git.
    """
    package = Path(hlp.__file__).parent

    def git(*words: str) -> str | None:
        command = ["git", *words]  # wherever the user's PATH has it; all words stand below
        try:
            done = subprocess.run(command, cwd=package, capture_output=True, text=True)  # noqa: S603
        except OSError:
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    if git("ls-files", "--error-unmatch", "__init__.py") is None:
        return None
    changed = git("status", "--porcelain", "--untracked-files=no", "--", ".")
    return f"{git('rev-parse', 'HEAD')}{'+' if changed else ''}"
