"""README and the documentation's pages as the tests see them: code blocks, links, commands."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from markdown_it import MarkdownIt
from markdown_it.token import Token

from bad_input import written

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
"""Everything with examples. Pages of what was tried name settings of their time."""
EXAMPLES = [path for path in PAGES if path.name != "tried.md"]
_PARSER = MarkdownIt().enable("table")
_NOT_RUN = re.compile(r"<!--\s*not run: (.+?)\s*-->")
_TITLE = re.compile(r'title="([^"]+)"')


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, `title`, text, line, and why it is not run (empty: it is)."""

    language: str
    title: str
    text: str
    line: int
    not_run: str


def blocks(path: Path) -> Iterator[Block]:
    """All fenced blocks of a page. `<!-- not run: WHY -->` stands right above one that is not."""
    before: Token | None = None
    for token in _PARSER.parse(path.read_text()):
        if token.type == "fence":
            assert token.map is not None
            reason = _NOT_RUN.search(before.content) if before is not None else None
            title = _TITLE.search(token.info)
            yield Block(
                token.info.partition(" ")[0],
                title[1] if title else "",
                token.content,
                token.map[0] + 1,
                reason[1] if reason else "",
            )
        before = token


def links(path: Path) -> Iterator[str]:
    """Targets of all links and pictures of a page."""
    for token in _PARSER.parse(path.read_text()):
        for child in token.children or []:
            target = child.attrGet("href") or child.attrGet("src")
            if target:
                yield str(target)


def commands(path: Path) -> Iterator[list[str]]:
    """The arguments of every `hlp …` in a page's shell blocks; a bare `…` stands for more."""
    for block in blocks(path):
        if block.language in {"", "sh"}:
            for line in block.text.replace("\\\n", " ").splitlines():
                words = shlex.split(line, comments=True)
                if words and words[0] in {"hlp", ".venv/bin/hlp"}:
                    yield [word for word in words[1:] if word != "…"]


def write_files(path: Path, folder: Path) -> None:
    """Write the blocks of a page that are whole files, of settings or of a camera."""
    for block in blocks(path):
        if block.title and block.language in ("yaml", "python"):
            written(folder / block.title, block.text)
