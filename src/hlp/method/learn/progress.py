"""Progress lines of learning, counted from outside: by what the work asks for.

The fingerprint of what is learnt holds the source of the code that learns it. Lines on a terminal
change nothing of it, so that code does not draw them.
"""

from collections.abc import Callable

from tqdm import tqdm

from hlp.records import Views


def counting_objects(
    views_of: Callable[[int], Views], what: str, objects: int
) -> Callable[[int], Views]:
    """`views_of`, with a line that counts the objects whose views it was asked for.

    The line begins with the first call and ends with the last of `objects` calls.
    """
    bars: list[tqdm] = []

    def counted(object_id: int) -> Views:
        if not bars:
            bars.append(tqdm(desc=what, total=objects, unit="object", disable=None))
        views = views_of(object_id)
        bars[0].update()
        if bars[0].n == objects:
            bars[0].close()
        return views

    return counted
