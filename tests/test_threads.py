"""Teams of threads, and the threads of libraries."""

import threading
import time

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from hlp.threads import ThreadTeam, one_blas_thread, set_compute_threads, take_blas, threads_here


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 2, 17])
def test_every_item_is_done_once_and_results_are_in_order(threads: int, count: int) -> None:
    done: list[int] = []

    def work(index: int) -> int:
        done.append(index)
        time.sleep(0.001 * (index % 3))
        return index**2

    assert ThreadTeam(threads).map(work, count) == [index**2 for index in range(count)]
    assert sorted(done) == list(range(count))


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("count", [0, 1, 5, 1000])
def test_ranges_cover_everything_once(threads: int, count: int) -> None:
    touched = np.zeros(count, dtype=int)

    def work(first: int, last: int) -> None:
        touched[first:last] += 1

    ThreadTeam(threads).map_ranges(work, count)
    assert (touched == 1).all()


def test_the_caller_does_not_wait_for_helpers_that_have_not_started() -> None:
    """While its only helper is busy elsewhere, the caller does all items."""
    team, release = ThreadTeam(2), threading.Event()
    team._helpers.submit(release.wait)
    names = team.map(lambda _: threading.current_thread().name, 4)
    release.set()
    assert set(names) == {threading.current_thread().name}


@pytest.mark.parametrize(
    ("threads", "count", "share"), [(4, 4, 1), (4, 9, 1), (4, 2, 2), (4, 1, 4)]
)
def test_threads_do_not_multiply_where_a_team_works_for_another(
    threads: int, count: int, share: int
) -> None:
    """A team in a function of another team has that one's threads, divided by its workers."""
    inner = ThreadTeam(threads)

    def work(_: int) -> tuple[int, int]:
        return threads_here(threads), len(set(inner.map(lambda _: threading.get_ident(), 50)))

    for left, used in ThreadTeam(threads).map(work, count):
        assert left == share and used <= share
    assert threads_here(threads) == threads


def test_who_is_left_at_work_takes_the_threads_of_those_who_are_done() -> None:
    others_done = threading.Barrier(2, timeout=10)

    def work(index: int) -> tuple[int, int]:
        before = threads_here(4)
        others_done.wait()
        deadline = time.perf_counter() + 10.0
        while index == 0 and threads_here(4) == before and time.perf_counter() < deadline:
            time.sleep(0.001)
        return before, threads_here(4)

    assert ThreadTeam(4).map(work, 2)[0] == (2, 4)
    assert threads_here(4) == 4


def test_a_smaller_team_takes_no_share_that_it_was_not_given() -> None:
    assert ThreadTeam(8).map(lambda _: threads_here(2), 2) == [2, 2]


@pytest.mark.parametrize("threads", [1, 3])
def test_after_an_error_no_other_item_begins(threads: int) -> None:
    begun: list[int] = []
    barrier = threading.Barrier(threads, timeout=10)

    def work(index: int) -> None:
        begun.append(index)
        barrier.wait()
        if index == 0:
            raise KeyboardInterrupt
        time.sleep(0.2)

    team = ThreadTeam(threads)
    with pytest.raises(KeyboardInterrupt):
        team.map(work, 100)
    assert len(begun) == threads
    assert team.map(abs, 3) == [0, 1, 2]
    assert threads_here(7) == 7


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
