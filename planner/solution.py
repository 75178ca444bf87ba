"""Solutions: the optimum that a search ends with, as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from octoplan.model.paths import Array
from octoplan.model.support.value import Count
from octoplan.planner.block import Constraints
from octoplan.planner.nlp_options import NlpOptions


@dataclass(frozen=True)
class Trial:
    """The result of one initial guess.

    Attributes
    ----------
    objective : float
        Value at the point at which the solver stopped.
    met : bool
        Whether this point is an optimum that the search accepts.
    iterations : int
        Iterations of the solver.
    """

    objective: float
    met: bool
    iterations: Count


@dataclass(frozen=True, eq=False)
class Solution:
    """The optimum that a search ends with.

    Attributes
    ----------
    options : NlpOptions
        Options of the last program. The mode is "nearest" if the targets cannot be met.
    tensions : (n_sections, n), or (n_tendons,) if sections differ in their number of tendons
        [N].
    lam_x, lam_g : tuple of float
        Multipliers of bounds and constraints of the last program, scaled, with CasADi's signs.
    starts : tuple of Trial
        Results of the initial guesses, in order.
    stopped : bool
        Whether the time limit ended the search. The tensions are the best that were found.
    jump : float
        Relative change of the tensions from the tensions of the plan `near`, if the search left
        the branch of that plan; otherwise 0.
    lost : float
        Fraction of the effort that a cheaper optimum of the coarse mesh saved, if finer meshes do
        not have this optimum; otherwise 0.
    in_the_way : str
        Description of the obstacle nearest to the plan without obstacles, if that plan meets the
        targets and no plan that keeps clear was found; otherwise empty.
    unstable : bool
        Whether all shapes that meet the targets are below the stability margin.
    load_path : tuple of (n_tendons,)
        Tensions [N] that lead an arm in contact to the shape. From rest the loads act first; then
        tensions change in straight lines to the first, to the next, and to the tensions of the
        solution. Empty if the load path from rest is straight.
    avoidance : Constraints or None
        Inequalities of the last program that keep the arm clear of obstacles.
    base : tuple of float
        Values of the base joints: insertion [m] and rotation [rad]; empty for a fixed base.
    sampled : int
        Number of shapes that were sampled for further guesses; 0 if the first guesses sufficed.
    iterations : int
        Iterations of the last program.
    optimum : NlpSolution or None
        The refined optimum as a point of its program, in the result of a search. A plan stores this
        point apart from its solution: the point is not saved.
    """

    options: NlpOptions
    tensions: Array
    lam_x: tuple[float, ...]
    lam_g: tuple[float, ...]
    starts: tuple[Trial, ...]
    stopped: bool = False
    jump: float = 0.0
    lost: float = 0.0
    in_the_way: str = ""
    unstable: bool = False
    load_path: tuple[tuple[float, ...], ...] = ()
    avoidance: Constraints | None = None
    base: tuple[float, ...] = ()
    sampled: Count = 0
    iterations: Count = 0
    optimum: Any = field(default=None, repr=False, kw_only=True)

    @property
    def controls(self) -> Array:
        """The tensions (n_tendons,) [N], followed by the values of base joints if any."""
        return np.append(self.tensions, self.base)

    @property
    def n_equal_optima(self) -> int:
        """The number of initial guesses that lead to the best objective."""
        return n_equal_optima(self.starts)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Solution):
            return NotImplemented
        names = [f.name for f in fields(self) if f.name not in ("tensions", "optimum")]
        same = all(getattr(self, name) == getattr(other, name) for name in names)
        return same and np.array_equal(self.tensions, other.tensions)

    __hash__ = None  # type: ignore[assignment]


def n_equal_optima(trials: Sequence[Trial]) -> int:
    """Return the number of trials that end at the best objective, to a thousandth."""
    best = min((trial.objective for trial in trials if trial.met), default=float("inf"))
    near = best + 1e-3 * abs(best) + 1e-12
    return sum(trial.met and trial.objective <= near for trial in trials)
