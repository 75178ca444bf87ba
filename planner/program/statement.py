"""How a planning question is stated as a nonlinear program, and what solved it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from model.errors import InputError
from planner.program.effort import Norm

Solver = Literal["auto", "ipopt"]
SOLVERS: tuple[Solver, ...] = ("auto", "ipopt")
# Of 40 solves of tips, in the paper's scene and in silicone under water, each with a program that
# fatrop takes, where evaluations are most of the time.
_FATROP = "; fatrop saves a third of a solve at most and loses one in seven under water"
Mode = Literal["exact", "closest", "nearest"]
STAGES = 3


def check_solver(solver: Any) -> Solver:
    """Return the name of a solver, or raise InputError."""
    if solver not in SOLVERS:
        raise InputError("solver", solver, ", ".join(SOLVERS) + _FATROP * (solver == "fatrop"))
    return solver  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Statement:
    """The choices that the program's functions depend on.

    Attributes
    ----------
    solver : "auto" or "ipopt"
        What is to solve it; of a plan, what did.
    norm : "2", "1" or "inf"
        What effort is.
    mode : "exact", "closest" or "nearest"
        How the targets are read, see planner.program.objective.
    limited : bool
        Whether the total pull has a limit.
    refinement : int
        Of the mesh, whose elements have three Gauss stages.
    margin : float
        The least stability that is accepted, see planner.certificate.
    modes : int
        How many of the least stable modes are held to it; none where stability is only checked.
    floor : float
        What these are held to at least: an arm that is about to yield does not settle.
    wound : bool
        Whether strokes have limits: then the lengths of the tendons are unknowns.
    iterations : int
        Of a plan, how many its solution took on the last mesh.
    """

    solver: Solver = "ipopt"
    norm: Norm = "2"
    mode: Mode = "exact"
    limited: bool = False
    refinement: int = 4
    margin: float = 0.0
    modes: int = 0
    floor: float = 1e-2
    wound: bool = False
    iterations: int = 0

    @property
    def least(self) -> float:
        """The stability that modes are held to."""
        return max(self.margin, self.floor)

    def but(self, **changes: Any) -> Statement:
        """Return the statement with some choices changed."""
        return replace(self, **changes)
