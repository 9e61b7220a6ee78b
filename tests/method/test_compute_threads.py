import numpy as np
from threadpoolctl import ThreadpoolController

from hlp.method.compute_threads import one_blas_thread


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
