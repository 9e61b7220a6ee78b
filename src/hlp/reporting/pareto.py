"""The Pareto front of recall against time: the runs that no other beats in both."""

from collections.abc import Sequence


def pareto_front(times: Sequence[float], recalls: Sequence[float]) -> list[int]:
    """Places of the points on the front, from the fastest to the one with the highest recall.

    A point is left out if another one is at least as fast and at least as good, and better in one
    of the two. Equal points stand on the front together.
    """
    front: list[int] = []
    for place in sorted(range(len(times)), key=lambda i: (times[i], -recalls[i])):
        better = not front or recalls[place] > recalls[front[-1]]
        point = times[place], recalls[place]
        if better or point == (times[front[-1]], recalls[front[-1]]):
            front.append(place)
    return front
