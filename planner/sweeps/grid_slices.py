"""Points that follow each other, as slices of the grid that they fill, last dimension fastest."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

Slices = tuple[slice, ...]


def grid_slices(begin: int, end: int, shape: Sequence[int]) -> Iterator[tuple[Slices, int, int]]:
    """Yield slices of a grid that hold the points from begin to end, in order.

    Parameters
    ----------
    begin, end : int
        Numbers of the first point and of the one after the last.
    shape : sequence of int
        Of the grid.

    Yields
    ------
    tuple
        A slice for each dimension, and the numbers of the first point in them and of the one after
        its last.
    """
    if not shape:
        yield (), begin, end
        return
    row = math.prod(shape[1:])
    while begin < end:
        i, inside = divmod(begin, row)
        if inside or end - begin < row:
            # Part of a row: slices of what is left of its dimensions.
            stop = min(end, (i + 1) * row)
            for part, a, b in grid_slices(inside, stop - i * row, shape[1:]):
                yield (slice(i, i + 1), *part), a + i * row, b + i * row
        else:
            stop = end - end % row
            yield (slice(i, stop // row), *(slice(0, n) for n in shape[1:])), begin, stop
        begin = stop
