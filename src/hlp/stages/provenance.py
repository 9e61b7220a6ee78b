"""What a result was made with: HLP's own source, its commit, and the libraries' versions."""

import hashlib
import platform
import subprocess
from importlib.metadata import version
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


def library_versions() -> dict[str, str]:
    """Versions of Python, of HLP and of the libraries that affect its results."""
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


def git_revision() -> str | None:
    """Commit of the checkout that HLP runs from, followed by `+` if files have been changed since.

    None for an installed package, even inside another checkout, and without git.
    """
    package = Path(hlp.__file__).parent

    def git(*words: str) -> str | None:
        try:
            # All words stand below; git is wherever the user's PATH has it.
            done = subprocess.run(  # noqa: S603
                ["git", *words],  # noqa: S607
                cwd=package,
                capture_output=True,
                text=True,
            )
        except OSError:
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    if git("ls-files", "--error-unmatch", "__init__.py") is None:
        return None
    changed = git("status", "--porcelain", "--untracked-files=no", "--", ".")
    return f"{git('rev-parse', 'HEAD')}{'+' if changed else ''}"
