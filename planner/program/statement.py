"""How a planning question is stated as a nonlinear program."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from planner.program.effort import Norm

Form = Literal["condensed", "multiple-shooting"]
Mode = Literal["exact", "closest", "nearest"]
FORMS: tuple[Form, ...] = ("condensed", "multiple-shooting")


@dataclass(frozen=True)
class Statement:
    """The choices that the program's functions depend on.

    Attributes
    ----------
    form : "condensed" or "multiple-shooting"
        Unknowns: the tensions alone, or with the states of all elements.
    norm : "2", "1" or "inf"
        What effort is.
    mode : "exact", "closest" or "nearest"
        How the targets are read, see planner.program.problem.
    limited : bool
        Whether the total pull has a limit.
    scheme, refinement
        Collocation, by its name in model.forward, and the mesh.
    margin : float
        The least stability that is accepted, see planner.certificate.
    modes : int
        How many of the least stable modes are held to it; none where stability is only checked.
    floor : float
        What these are held to at least: an arm that is about to yield does not settle.
    wound : bool
        Whether strokes have limits: then the lengths of the tendons are unknowns.
    """

    form: Form = "condensed"
    norm: Norm = "2"
    mode: Mode = "exact"
    limited: bool = False
    scheme: str = "gauss6"
    refinement: int = 4
    margin: float = 0.0
    modes: int = 0
    floor: float = 1e-2
    wound: bool = False

    @property
    def stages(self) -> int:
        """How many stages the elements have; other schemes of the same order have as many."""
        most = 4 if self.scheme.startswith("gauss") else 3
        return max(1, min(int(self.scheme[-1]) // 2, most))

    @property
    def least(self) -> float:
        """The stability that modes are held to."""
        return max(self.margin, self.floor)

    def but(self, **changes: Any) -> Statement:
        """Return the statement with some choices changed."""
        return replace(self, **changes)
