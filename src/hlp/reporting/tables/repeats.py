"""Mean and spread of repeats, such as one configuration with several seeds."""

from collections.abc import Callable, Sequence
from statistics import fmean, stdev


def mean_and_spread(
    repeats: Sequence[Sequence[float | None]],
) -> tuple[list[str], list[str]]:
    """Means of shares over two or more repeats, and their standard deviations.

    `repeats` holds the same shares of each repeat, None where one is not known: its cell is empty.
    """
    columns = list(zip(*repeats, strict=True))
    means = [_over_repeats(each, fmean, "{:.3f}") for each in columns]
    return means, [_over_repeats(each, stdev, "{:.4f}") for each in columns]


def _over_repeats(
    shares: Sequence[float | None], statistic: Callable[[list[float]], float], form: str
) -> str:
    known = [each for each in shares if each is not None]
    return form.format(statistic(known)) if len(known) == len(shares) else ""
