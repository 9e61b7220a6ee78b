"""Interface of the cameras, and how one in a user's own file is found."""

import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from hlp.errors import HlpError, InputError, MissingFileError
from hlp.records import CameraImage


@dataclass(frozen=True)
class BrokenImage:
    """An image that could not be read: what it is called, and why."""

    name: str
    error: HlpError


@runtime_checkable
class Camera(Protocol):
    """Delivers images until it ends. A generator of `CameraImage` is one, too."""

    def __iter__(self) -> Iterator[CameraImage | BrokenImage]:
        """The images as they come; waits for the next one.

        An image that cannot be used may be left out or delivered as a `BrokenImage`.
        """
        ...

    def close(self) -> None:
        """Free the device. Called once, also after an error or Ctrl-C."""
        ...


def load_camera(source: str) -> Camera:
    """The camera that FILE.py:NAME makes: a class or a function without arguments.

    Raises MissingFileError and InputError naming what is wrong with `source`. The file is executed.
    """
    file, _, name = source.rpartition(":")
    path = Path(file).expanduser()
    if not path.is_file():
        raise MissingFileError(f"source={source}: there is no file {path} (give FILE.py:CLASS)")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise InputError(f"source={source}: {path} is no Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    make: Any = getattr(module, name, None)
    if not callable(make):
        raise InputError(f"source={source}: {path} has no class or function {name}")
    camera = make()
    if not isinstance(camera, Camera):
        raise InputError(
            f"source={source}: what {name}() makes has no __iter__ or no close, see hlp live --help"
        )
    return camera
