"""How a planning question is stated as a nonlinear program, and what solved it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta

from model.errors import InputError
from model.mesh import FINEST
from model.paths import Array
from model.quantities import Count

Norm = Literal["2", "1", "inf"]
NORMS: tuple[Norm, ...] = ("2", "1", "inf")


def effort(tensions: Array, norm: Norm) -> Array:
    """Return the norms (...) of tensions (..., n_tendons) [N]."""
    order = {"2": 2, "1": 1, "inf": np.inf}[norm]
    return np.asarray(np.linalg.norm(tensions, order, axis=-1))


def check_norm(norm: Any) -> Norm:
    """Return the norm by its name, or raise InputError."""
    if str(norm) not in NORMS:
        raise InputError(
            "norm", norm, "2 (least squares), 1 (least total pull) or inf (least maximum)"
        )
    return str(norm)  # type: ignore[return-value]


Solver = Literal["auto", "ipopt", "fatrop"]
SOLVERS: tuple[Solver, ...] = ("auto", "ipopt", "fatrop")
Mode = Literal["exact", "closest", "nearest"]


def check_solver(solver: Any) -> Solver:
    """Return the name of a solver, or raise InputError."""
    if solver not in SOLVERS:
        raise InputError("solver", solver, ", ".join(SOLVERS))
    return solver  # type: ignore[no-any-return]


@dataclass(frozen=True)
class Statement:
    """The choices that the program's functions depend on.

    Attributes
    ----------
    solver : "auto", "ipopt" or "fatrop"
        What is to solve it; of a plan, what did.
    norm : "2", "1" or "inf"
        What effort is.
    mode : "exact", "closest" or "nearest"
        How the targets are read, see planner.program.program.
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
    refinement: Annotated[int, Meta(ge=1, le=FINEST)] = 4
    margin: float = 0.0
    modes: Annotated[int, Meta(ge=0, le=1)] = 0
    floor: float = 1e-2
    wound: bool = False
    iterations: Count = 0

    @property
    def least(self) -> float:
        """The stability that modes are held to."""
        return max(self.margin, self.floor)

    def but(self, **changes: Any) -> Statement:
        """Return the statement with some choices changed."""
        return replace(self, **changes)
