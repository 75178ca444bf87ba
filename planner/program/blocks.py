"""What the capabilities of a planner add to its program: blocks of unknowns, with equations.

Behind the tensions, and what the objective adds to them, a program has the load factor, which is 1,
then blocks: the states of the arm, and one for each further capability. A block has as many
equations as unknowns, so that these follow from the tensions.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Protocol

import casadi as ca

from model.paths import Array
from model.transcription.equations import Term
from model.transcription.kernels import Kernel, Places
from model.transcription.system import System


class Block(Protocol):
    """A block of unknowns and equations, as a structure without numbers."""

    @property
    def size(self) -> int:
        """How many unknowns it has, and as many equations."""

    @property
    def is_linear(self) -> bool:
        """Whether its equations are linear in its own unknowns."""

    def terms(self, place: Places, start: int, row: int) -> list[Term]:
        """Return the terms of its equations, the first of which is at `row`.

        Its unknowns begin at `start`; `place` (n_x,) are those of the layout's in the program.
        """

    def numbers(self, at: System, along: Array) -> list[Array]:
        """Return the numbers of its terms, (n_c, N) of each, for the equations of an arm.

        `along` (3, k) are the directions of all responses.
        """

    def scales(self, at: System) -> tuple[Array, Array]:
        """Return what one unit of each unknown, and of each equation, is worth (size,)."""


@lru_cache(maxsize=1)
def scaled() -> Kernel:
    """Return the kernel of a number times an unknown."""
    x, c = ca.SX.sym("x"), ca.SX.sym("c")
    return Kernel("scaled", x, c, c * x)
