"""The commands of the command line: a function each, and its help as a text in `help/`."""

from importlib import import_module
from pathlib import Path

MULTIRUN = {"-m", "--multirun"}
_FILLED_BY = {"run": "run", "download": "folders"}
"""Commands whose help lists what there is, and the modules that fill it in."""


def help_text(command: str) -> str:
    """What `hlp COMMAND --help` prints."""
    path = Path(__file__).with_name("help") / f"{command}.txt"
    text = path.read_text(encoding="utf-8").rstrip("\n")
    if command in _FILLED_BY:
        return str(import_module(f"hlp.commands.{_FILLED_BY[command]}").filled(text))
    return text
