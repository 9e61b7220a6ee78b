import threading

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from hlp.kernels import one_blas_thread, set_compute_threads, take_blas


@pytest.fixture
def libraries():
    """The numerical libraries, BLAS with two threads, whatever the environment says."""
    found = ThreadpoolController()
    take_blas()
    with found.limit(limits=2, user_api="blas"):
        yield found


def blas_threads():
    np.ones((2, 2)) @ np.ones((2, 2))
    found = ThreadpoolController().select(user_api="blas").info()
    return {each["num_threads"] for each in found}


def test_blas_has_one_thread_until_the_last_block_ends(libraries):
    """Blocks of two threads overlap: the first one that ends is not the last."""
    first, second = one_blas_thread(libraries), one_blas_thread(libraries)
    first.__enter__()
    assert blas_threads() == {1}
    second.__enter__()
    first.__exit__(None, None, None)
    assert blas_threads() == {1}
    second.__exit__(None, None, None)
    assert blas_threads() == {2}


def test_any_thread_of_python_sets_them(libraries):
    """Also where another one, which still lives, has set them first.

    FAISS's BLAS asks OpenMP, which has a number for each thread of Python: that of the environment.
    """
    found = []

    def block():
        found.append(blas_threads())
        with one_blas_thread(libraries):
            found.append(blas_threads())
        found.append(blas_threads())

    def whole_process():
        set_compute_threads(1)
        found.append(blas_threads())

    for work in (block, whole_process):
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
    before, *others = found
    assert 2 in before and others == [{1}, before, {1}]
