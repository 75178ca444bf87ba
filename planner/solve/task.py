"""A planning question with its answer still open, the programs that state it, and the answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from model.arm import Arm
from model.effects import Extension
from model.paths import Array
from model.quantities import Count
from model.scene import Scene
from planner.avoidance.rows import Avoidance, avoidance_of
from planner.program.problem import Problem
from planner.program.terms import pulling_tendons
from planner.question import Limits, Mode, Statement
from planner.solve.ipopt import Candidate
from planner.targets.base import Target

# Initial guesses at most by default.
MOST = 14


@dataclass(frozen=True, eq=False)
class Task:
    """The question of a search.

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

    @property
    def most(self) -> int:
        """How many initial guesses are made at most."""
        return MOST if self.guesses is None else self.guesses

    @property
    def stated(self) -> tuple[Target, ...]:
        """The targets of the program."""
        return self.targets

    @property
    def bare(self) -> Scene:
        """The scene in the paper's balance and without loads, where strains are closed forms."""
        return Scene(*[Extension()] * self.scene.has(Extension))

    @property
    def allowed(self) -> Limits:
        """The limits, with tendons that a target does not let pull held at their minima."""
        pulling, lower = pulling_tendons(self.arm, self.targets), self.limits.lower
        upper = [most if j in pulling else lower[j] for j, most in enumerate(self.limits.upper)]
        return replace(self.limits, upper=tuple(upper))

    def problem(self, statement: Statement | None = None) -> Problem:
        """Return the program by a statement, its own unless given."""
        question = (self.arm, self.scene, self.stated, self.allowed, statement or self.statement)
        return Problem(*question, self.machine_code)

    def coarse(self, mode: Mode) -> Statement:
        """Return the statement on a mesh that costs little: good to 1e-4 of L or so.

        Without extension a slender tip winds up further, and takes a finer mesh.
        """
        return self.statement.but(mode=mode, refinement=1 if self.scene.has(Extension) else 2)


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
        The obstacle that the plan without obstacles comes nearest to, where only obstacles keep the
        targets from being met; empty else.
    unstable : bool
        Whether only shapes below the stability margin meet the targets.
    load_path : tuple of (n_tendons,)
        Of an arm in contact, tensions by which it comes to the shape: from rest tensions and loads
        grow in proportion to the first, then they change in straight lines to the next and to the
        plan's. Empty where it comes there from rest.
    avoidance : Avoidance or None
        The inequalities of the program that keep the arm clear.
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
    avoidance: Avoidance | None = None

    @classmethod
    def at(cls, end: Candidate, trials: Sequence[Trial], **more: Any) -> SearchResult:
        """Return the result of a search that ends at a candidate, after trials."""
        of = end.problem
        return SearchResult(
            end.statement,
            of.arm.by_section(end.tensions),
            tuple(end.lam_x[: of.n_free].tolist()),
            tuple(end.lam_g[: of.n_outer].tolist()),
            tuple(trials),
            avoidance=avoidance_of(of.targets),
            **more,
        )


def agreed(starts: Sequence[Trial]) -> int:
    """Return how many starts ended at the best objective, to a thousandth."""
    best = min((start.objective for start in starts if start.met), default=float("inf"))
    near = best + 1e-3 * abs(best) + 1e-12
    return sum(start.met and start.objective <= near for start in starts)
