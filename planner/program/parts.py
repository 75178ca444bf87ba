"""The parameters of a program, part by part."""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import NamedTuple


class Parts(NamedTuple):
    """Where the parts of the parameters are.

    Attributes
    ----------
    given : slice
        Numbers of the objective.
    unit : slice
        What one unit of each tension is worth [N].
    force : slice
        Of the responses.
    numbers : slice
        Of the equations.
    scale, row_scale : slice
        What one unit of each unknown from the load factor on, and of each equation, is worth.
    defect : slice
        By how much what is measured on the mesh is off, see planner.program.defect.
    """

    given: slice
    unit: slice
    force: slice
    numbers: slice
    scale: slice
    row_scale: slice
    defect: slice

    @classmethod
    def of(cls, sizes: tuple[int, ...]) -> Parts:
        """Return the parts of given sizes, one after the other."""
        return cls(*(slice(a, b) for a, b in pairwise([0, *accumulate(sizes)])))

    @property
    def size(self) -> int:
        """How many parameters there are."""
        return int(self.defect.stop)
