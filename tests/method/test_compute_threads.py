import threading

import numpy as np
from threadpoolctl import ThreadpoolController

from hlp.method.compute_threads import one_blas_thread, set_compute_threads


def blas_threads() -> set[int]:
    np.ones((2, 2)) @ np.ones((2, 2))
    found = ThreadpoolController().select(user_api="blas").info()
    return {each["num_threads"] for each in found}


def test_blas_has_one_thread_until_the_last_block_ends() -> None:
    """Blocks of two threads overlap: the first one that ends is not the last."""
    libraries = ThreadpoolController()
    with libraries.limit(limits=2, user_api="blas"):
        first, second = one_blas_thread(libraries), one_blas_thread(libraries)
        first.__enter__()
        assert blas_threads() == {1}
        second.__enter__()
        first.__exit__(None, None, None)
        assert blas_threads() == {1}
        second.__exit__(None, None, None)
        assert blas_threads() == {2}


def test_any_thread_of_python_sets_them() -> None:
    """Also where another one, which still lives, has set them first."""
    libraries, found = ThreadpoolController(), []

    def block() -> None:
        with one_blas_thread(libraries):
            found.append(blas_threads())
        found.append(blas_threads())

    def whole_process() -> None:
        set_compute_threads(1)
        found.append(blas_threads())

    with libraries.limit(limits=2, user_api="blas"):
        for each in (block, whole_process):
            thread = threading.Thread(target=each)
            thread.start()
            thread.join()
    assert found == [{1}, {2}, {1}]
