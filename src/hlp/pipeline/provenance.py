"""What a result was made with: versions of the libraries and a digest of HLP's own code."""

import hashlib
import platform
from importlib.metadata import version
from pathlib import Path

import hlp

LIBRARIES = (
    "numpy",
    "scipy",
    "numba",
    "torch",
    "pytorch-lightning",
    "opencv-python-headless",
    "trimesh",
    "pyrender",
    "hydra-core",
    "mlflow",
)


def library_versions() -> dict[str, str]:
    """Versions of Python, of HLP and of the libraries that decide its numbers."""
    own = {"python": platform.python_version(), "hlp": hlp.__version__}
    return own | {name: version(name) for name in LIBRARIES}


def code_digest() -> str:
    """Digest (16 hex digits) of HLP's Python files as they are on disk now."""
    package = Path(hlp.__file__).parent
    digest = hashlib.blake2b(digest_size=8)
    for source in sorted(package.rglob("*.py")):
        digest.update(source.relative_to(package).as_posix().encode() + b"\0")
        digest.update(source.read_bytes() + b"\0")
    return digest.hexdigest()
