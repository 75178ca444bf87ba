"""A planning question as one value, and what a search for its answer ends with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Self

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.effects import Extension
from octoplan.model.forward import FINEST_ACCURACY
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.quantities import Count
from octoplan.planner.extensions.avoidance.rows import ClearanceConstraints
from octoplan.planner.program.terms import Targets
from octoplan.planner.question import Limits, Mode, Statement
from octoplan.planner.targets.base import Target

# Initial guesses at most by default.
MOST = 14


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked.

    Attributes
    ----------
    limits : Limits
        Those of all tendons; `allowed` are those with what the targets do not let pull held.
    statement : Statement
        Its mode and mesh are chosen as the search goes on.
    accuracy : float
        What residuals are held to, over the arm's length.
    machine_code : bool
        Whether to work by compiled kernels.
    guesses : int or None
        Initial guesses that are tried, as far as so many differ; unless given, until enough of them
        agree, `MOST` at most.
    best_margin : bool
        Whether less than the stability margin is accepted where that cannot be had.
    mesh : int
        Refinement of the search's mesh; 0 for a mesh that suits arms that bend by less than a turn.
    """

    arm: Arm
    targets: tuple[Target, ...]
    scene: Scene
    limits: Limits
    statement: Statement
    accuracy: float
    machine_code: bool = field(default=False, kw_only=True, compare=False)
    guesses: int | None = field(default=None, kw_only=True, compare=False)
    best_margin: bool = field(default=False, kw_only=True, compare=False)
    mesh: int = field(default=0, kw_only=True, compare=False)

    @property
    def most(self) -> int:
        """How many initial guesses are made at most."""
        return MOST if self.guesses is None else self.guesses

    @cached_property
    def together(self) -> Targets:
        """The targets as one."""
        return Targets(self.arm, self.targets)

    @property
    def bare(self) -> Scene:
        """The scene in the paper's balance and without loads, where strains are closed forms."""
        return Scene(*[Extension()] * self.scene.has(Extension))

    @property
    def allowed(self) -> Limits:
        """The limits, with tendons that a target does not let pull held at their minima."""
        return self.limits.of_tendons(self.together.tendons)

    @property
    def sharper(self) -> float:
        """The accuracy of what has to be judged by the task's: two digits more."""
        return max(self.accuracy / 100, FINEST_ACCURACY)

    def avoiding(self, avoidance: ClearanceConstraints | None) -> Self:
        """Return the task with inequalities that keep the arm clear, if there are any."""
        if avoidance is None:
            return self
        return replace(self, targets=avoidance.beside(self.targets))

    def settled(self, tensions: Array) -> Shape:
        """Return the shape under tensions, two digits more accurate; raises what settle does.

        The error of a shape is that of the tip's place, over the arm's length. Its frame, which
        targets measure too, may be off by thirty times as much.
        """
        T = tuple(np.ravel(tensions).tolist())
        return _settled(self.arm, T, self.scene, self.sharper, self.machine_code)

    def coarse(self, mode: Mode) -> Statement:
        """Return the statement on a mesh that costs little: good to 1e-4 of L or so.

        Without extension a slender tip winds up further, and takes a finer mesh.
        """
        usual = 1 if self.scene.has(Extension) else 2
        return self.statement.but(mode=mode, refinement=self.mesh or usual)


@lru_cache(maxsize=8)
def _settled(
    arm: Arm, tensions: tuple[float, ...], scene: Scene, accuracy: float, machine_code: bool
) -> Shape:
    return settle(arm, tensions, scene, accuracy, compile=machine_code)


@dataclass(frozen=True)
class Trial:
    """One initial guess and what became of it: the objective reached, and whether it was met."""

    objective: float
    met: bool
    iterations: Count


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What a search ends with.

    Attributes
    ----------
    statement : Statement
        How it was stated in the end: its `mode` is "nearest" if the targets could not be met.
    tensions : (n_sections, n), or (n_tendons,) where sections differ in number
        [N].
    lam_x, lam_g : tuple of float
        Multipliers of bounds and constraints of the problem, scaled, CasADi's signs.
    starts : tuple of Trial
        The initial guesses tried, in order.
    stopped : bool
        Whether the time limit ended the search: these are the best tensions it had come to.
    jump : float
        How far the tensions are from those of the plan that was to be followed, over their norm,
        where its branch was left; 0 elsewhere, and without one.
    lost : float
        By what fraction of the effort the coarse mesh of the search had a cheaper optimum that was
        lost on finer ones; 0 if none.
    in_the_way : str
        The obstacle that the plan without obstacles comes nearest to, if that plan meets the
        targets and no plan that keeps clear was found; empty otherwise.
    unstable : bool
        Whether only shapes below the stability margin meet the targets.
    load_path : tuple of (n_tendons,)
        Of an arm in contact, tensions by which it comes to the shape: from rest tensions and loads
        grow in proportion to the first, then they change in straight lines to the next and to the
        plan's. Empty where it comes there from rest.
    avoidance : ClearanceConstraints or None
        The inequalities of the program that keep the arm clear.
    sampled : int
        Number of shapes that were sampled for further guesses; 0 if the first guesses sufficed.
    """

    statement: Statement
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
    avoidance: ClearanceConstraints | None = None
    sampled: Count = 0


def agreed(starts: Sequence[Trial]) -> int:
    """Return how many starts ended at the best objective, to a thousandth."""
    best = min((start.objective for start in starts if start.met), default=float("inf"))
    near = best + 1e-3 * abs(best) + 1e-12
    return sum(start.met and start.objective <= near for start in starts)
