"""Number of threads of the numerical libraries."""

import cv2
from threadpoolctl import threadpool_limits


def set_compute_threads(threads: int) -> None:
    """Set the threads of BLAS and OpenCV, so that the same settings give the same bits.

    The number of BLAS threads changes the last bits of sums. BLAS has little to do and gets one.
    """
    threadpool_limits(1, user_api="blas")
    cv2.setNumThreads(threads)
