"""What building a wheel adds: links and pictures of README, and compiled kernels.

Package indexes show README without the files beside it. Where HLP_REPOSITORY names the address
(https://HOST/OWNER/NAME), README's links and pictures lead there; otherwise it stays as it is.

Where HLP_COMPILE is set, the wheel holds the kernels of this system as machine code.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

_PICTURES = (".jpg", ".png", ".svg", ".webp")
_TARGET = re.compile(r"(!?\[[^\]]*\]\()(?!https?://|#)([^)\s]+)(\))")


class CustomMetadataHook(MetadataHookInterface):
    """Called by hatchling whenever it builds a wheel or a source archive."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Fill in `readme` and, if the address is known, `urls`. Raises ValueError for another."""
        repository = os.environ.get("HLP_REPOSITORY", "").rstrip("/")
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        if repository:
            if not re.fullmatch(r"https://[^/\s@]+/\S+", repository):
                raise ValueError(f"HLP_REPOSITORY={repository}: write https://HOST/OWNER/NAME")
            text = with_addresses(text, repository)
            metadata["urls"] = {
                "Source": repository,
                "Documentation": f"{repository}/tree/HEAD/docs",
                "Changelog": f"{repository}/blob/HEAD/CHANGELOG.md",
                "Issues": f"{repository}/issues",
            }
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def with_addresses(text: str, repository: str) -> str:
    """A page of Markdown whose links and pictures of files lead to the repository."""

    def absolute(found: re.Match[str]) -> str:
        kind = "raw" if found[2].partition("#")[0].endswith(_PICTURES) else "blob"
        return f"{found[1]}{repository}/{kind}/HEAD/{found[2]}{found[3]}"

    return _TARGET.sub(absolute, text)


class CompiledKernels(BuildHookInterface):
    """Called by hatchling around the building of a wheel."""

    @property
    def wanted(self) -> bool:
        """Whether kernels are to be compiled."""
        return bool(os.environ.get("HLP_COMPILE"))

    def dependencies(self) -> list[str]:
        """What compiling needs beside hatchling: pip puts it where it builds."""
        if not self.wanted:
            return []
        names = {"numba", *self.metadata.config["dependency-groups"]["detect"]}
        stated = self.metadata.core.dependencies
        return ["setuptools", *(each for each in stated if re.split(r"[^\w-]", each)[0] in names)]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, unless a checkout is installed in place, whose sources may change."""
        if not self.wanted or version == "editable":
            return
        self._folder = TemporaryDirectory()  # until the wheel is written
        compiling = [sys.executable, str(Path(self.root, "hatch_kernels.py")), self._folder.name]
        subprocess.run(compiling, check=True)  # noqa: S603
        for path in Path(self._folder.name).iterdir():
            build_data["force_include"][str(path)] = f"hlp/{path.name}"
        build_data.update(pure_python=False, infer_tag=True)
