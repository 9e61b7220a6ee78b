"""Files written whole or not at all, and JSON read with errors that name the file."""

import json
import os
from pathlib import Path
from typing import Any

from hlp.errors import DataError


def write_json(path: Path, content: Any) -> None:
    """Write JSON; a crash or a full disk leaves no half file under that name."""
    begun = path.with_name(path.name + ".begun")
    begun.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    os.replace(begun, path)


def read_json(path: Path) -> Any:
    """Read JSON. Raises FileNotFoundError, and DataError naming a file that is no JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DataError(f"{path} is no JSON: {error}") from error
