"""The notebooks as pages, with the outputs that they are committed with, and a gallery of them."""

import base64
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_FORMULA = re.compile(r"\$([^$\n]+)\$")
_PICTURES = {"image/png": "png", "image/jpeg": "jpg"}
GALLERY = """\
# Notebooks

`hlp notebooks` copies them into a folder, to be changed and run. Those with pictures were run on
the demo.

"""


def notebook_pages(folder: Path) -> Iterator[tuple[str, str | bytes]]:
    """Paths in the site, and the content, of a page for each notebook and of the gallery."""
    gallery = GALLERY
    for path in sorted(folder.glob("*.ipynb")):
        cells = json.loads(path.read_text())["cells"]
        text, pictures = _page(cells, path.stem)
        yield f"notebooks/{path.stem}.md", text
        for name, content in pictures.items():
            yield f"notebooks/{name}", content
        title, _, words = "".join(cells[0]["source"]).removeprefix("# ").partition("\n\n")
        gallery += f"## [{title}]({path.stem}.md)\n\n{_plain(words)}\n\n"
        if pictures:
            gallery += f"[![{title}]({[*pictures][-1]}){{ loading=lazy }}]({path.stem}.md)\n\n"
    yield "notebooks/index.md", gallery


def _page(cells: list[dict[str, Any]], stem: str) -> tuple[str, dict[str, bytes]]:
    parts: list[str] = []
    pictures: dict[str, bytes] = {}
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(_plain(source))
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {})
            kind = next((kind for kind in _PICTURES if kind in data), None)
            if kind is not None:
                name = f"{stem}_{len(pictures) + 1}.{_PICTURES[kind]}"
                pictures[name] = base64.b64decode(data[kind])
                parts.append(f"![What the cell shows]({name}){{ loading=lazy }}")
            elif "text/markdown" in data:
                parts.append("".join(data["text/markdown"]))
            elif text := "".join(output.get("text", "")):
                parts.append(f"```text\n{text.rstrip()}\n```")
    return "\n\n".join(parts) + "\n", pictures


def _plain(words: str) -> str:
    """Markdown with formulas as code: what draws them would be loaded from the network."""
    return _FORMULA.sub(lambda found: f"`{found[1].replace(chr(92) + ',', ' ')}`", words)
