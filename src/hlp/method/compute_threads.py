"""Number of threads of the numerical libraries."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import cv2
import threadpoolctl
from threadpoolctl import ThreadpoolController, threadpool_limits


def set_compute_threads(threads: int) -> None:
    """Set the threads of BLAS and OpenCV, so that the same settings give the same bits.

    The number of BLAS threads changes the last bits of sums. BLAS has little to do and gets one.
    """
    take_blas()
    threadpool_limits(1, user_api="blas")
    cv2.setNumThreads(threads)


def take_blas() -> None:
    """Let this thread of Python set BLAS's threads, whichever has set them before.

    Since threadpoolctl 3.8 only the first thread that does may do so again, and what others ask for
    is passed over in silence.
    """
    controller = threadpoolctl.OpenBLASController
    if hasattr(controller, "clear_controlling_thread"):
        controller.clear_controlling_thread(force=True)


class OneBlasThread:
    """Gives BLAS one thread in this process as long as anybody is within the block.

    Blocks of several threads may overlap: the threads that BLAS had come back after the last one.
    """

    def __init__(self) -> None:
        self._guard, self._inside = threading.Lock(), 0

    @contextmanager
    def __call__(self, libraries: ThreadpoolController) -> Iterator[None]:
        """The block; `libraries` are those that are limited."""
        with self._guard:
            if self._inside == 0:
                take_blas()
                self._limit = libraries.limit(limits=1, user_api="blas")
            self._inside += 1
        try:
            yield
        finally:
            with self._guard:
                self._inside -= 1
                if self._inside == 0:
                    take_blas()
                    self._limit.restore_original_limits()


one_blas_thread = OneBlasThread()
