"""Metadata that needs the repository's address: links, and README with its pictures.

Package indexes show README without the files beside it. Where HLP_REPOSITORY names the address
(https://HOST/OWNER/NAME), README's links and pictures lead there; otherwise it stays as it is.
"""

import os
import re
from pathlib import Path
from typing import Any

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
