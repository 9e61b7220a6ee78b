"""Threads of the libraries that compute."""

import cv2
from threadpoolctl import threadpool_limits


def set_compute_threads(threads: int) -> None:
    """Give each library its threads, so that the same settings give the same bits.

    How BLAS shares out a sum decides its last bits. It has little to do and gets one thread.
    """
    threadpool_limits(1, user_api="blas")
    cv2.setNumThreads(threads)
