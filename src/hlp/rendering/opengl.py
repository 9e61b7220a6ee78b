"""RGB-D images of a mesh by OpenGL (pyrender on EGL).

Camera, light and depth are those of `rasterizer.render_rgbd`. pyrender is imported, and the
environment read, when the first image is rendered. A context only works in the process and thread
that created it; there is one per process, never deleted, because deleting one breaks all others.
"""

import logging
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from hlp.arrays import CameraMatrix, Image, Pose, Rgb
from hlp.records import Mesh
from hlp.rendering.shading import Light

_Picture = tuple[Rgb, Image]

_NEAR = 0.01  # m: near clipping plane
_INSTALL = (
    "OpenGL cannot start. Install the system packages libegl1 libgl1 libxrender1 "
    "(`apt-get install libegl1 libgl1 libxrender1`), or set rendering=numba"
)


@dataclass(frozen=True)
class _Context:
    """The process's OpenGL context, or why it has none, and the thread that it belongs to."""

    draw: Callable[..., _Picture] | None
    problem: str | None
    process: int = field(default_factory=os.getpid)
    thread: int = field(default_factory=threading.get_ident)

    @property
    def problem_here(self) -> str | None:
        """Why it cannot be used by the calling thread; None if it can."""
        if self.problem is None and self.process != os.getpid():
            return (
                "OpenGL was started before this process was forked and is unusable in it: "
                "start workers with spawn (or joblib's loky), or set rendering=numba"
            )
        if self.problem is None and self.thread != threading.get_ident():
            return (
                "OpenGL was started in another thread and only works there: "
                "render from that thread, or set rendering=numba"
            )
        return self.problem


_starting = threading.Lock()


def opengl_problem() -> str | None:
    """Why OpenGL cannot render here, as a message for the user; None if it can.

    The first call starts OpenGL and binds it to the calling thread.
    """
    return _context().problem_here


def render_rgbd(
    mesh: Mesh,
    pose_cam_obj: Pose,
    camera_matrix: CameraMatrix,
    shape: tuple[int, int],
    light: Light,
) -> _Picture:
    """Colour (black where nothing is) and depth (m, 0 = nothing) of one mesh in one pose.

    A mesh that is not the last one is uploaded: draw all poses of one before the next.
    Raises RuntimeError if OpenGL cannot run.
    """
    draw, problem = _context().draw, opengl_problem()
    if draw is None or problem is not None:
        raise RuntimeError(problem)
    # With a tight depth range the 24-bit buffer resolves far less than a micrometre.
    z = mesh.vertices @ pose_cam_obj[2, :3] + pose_cam_obj[2, 3]
    margin = 1e-3 * float(np.ptp(z)) + 1e-4
    near, far = max(float(z.min()) - margin, _NEAR), float(z.max()) + margin
    if far <= near:  # the whole mesh is behind the camera
        return np.zeros((*shape, 3), dtype=np.uint8), np.zeros(shape, dtype=np.float32)
    return draw(mesh, pose_cam_obj, camera_matrix, shape, light, (near, far))


def _context() -> _Context:
    with _starting:  # one thread starts it, others wait
        return _start()


@cache
def _start() -> _Context:
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")  # read by PyOpenGL when it is imported
    # PyOpenGL logs missing optional libraries as errors.
    logging.getLogger("OpenGL").setLevel(logging.CRITICAL)
    try:
        from hlp.rendering.blinn_phong import BlinnPhongScene
    except (ImportError, AttributeError, OSError) as error:
        return _Context(None, f"{_INSTALL} ({type(error).__name__}: {error})")
    from OpenGL.error import Error  # type: ignore[import-untyped]

    try:
        return _Context(BlinnPhongScene().render, None)
    except (Error, AssertionError, AttributeError, OSError, RuntimeError, ValueError) as error:
        return _Context(None, f"{_INSTALL} ({type(error).__name__}: {error})")
