"""Every item is done once, results are in order, errors reach the caller."""

import threading
import time

import numpy as np
import pytest

from hlp.kernels import ThreadTeam, threads_here


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
    assert team._helpers is not None
    team._helpers.submit(release.wait)
    names = team.map(lambda _: threading.current_thread().name, 4)
    release.set()
    assert set(names) == {threading.current_thread().name}


def test_helpers_take_part() -> None:
    barrier = threading.Barrier(3, timeout=10)  # all three must be at work at once

    def work(_: int) -> str:
        barrier.wait()
        return threading.current_thread().name

    assert len(set(ThreadTeam(3).map(work, 3))) == 3


@pytest.mark.parametrize("bad", [0, 1])
def test_errors_reach_the_caller_and_the_team_goes_on(bad: int) -> None:
    team = ThreadTeam(2)
    barrier = threading.Barrier(2, timeout=10)

    def work(index: int) -> int:
        barrier.wait()  # one item each
        if index == bad:
            raise ValueError("item is bad")
        return index

    with pytest.raises(ValueError, match="item is bad"):
        team.map(work, 2)
    assert team.map(abs, 3) == [0, 1, 2]


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

    with pytest.raises(KeyboardInterrupt):
        ThreadTeam(threads).map(work, 100)
    assert len(begun) == threads
    assert threads_here(7) == 7
