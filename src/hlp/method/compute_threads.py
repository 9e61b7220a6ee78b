"""Threads of the libraries that compute."""

import cv2
import torch
from threadpoolctl import threadpool_limits


def set_compute_threads(threads: int, torch_threads: int) -> None:
    """Give each library its threads, so that the same settings give the same bits.

    How torch and BLAS share out a sum decides its last bits. So torch's number is part of the
    result (`trainer.torch_threads`), and BLAS, which has little to do, gets one thread.
    """
    torch.set_num_threads(torch_threads)
    threadpool_limits(1, user_api="blas")
    cv2.setNumThreads(threads)
