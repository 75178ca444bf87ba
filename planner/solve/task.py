"""A planning question with its answer still open, and the programs that state it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from model.arm import Arm
from model.effects import Extension, PrintedStatics
from model.paths import Array
from model.scene import Scene
from planner.program.limits import Limits
from planner.program.problem import Problem, build
from planner.program.statement import Form, Mode, Statement
from planner.solve.ipopt import Solution
from planner.targets.base import Target

# Initial guesses at most, unless a number is asked for.
MOST = 14


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked of a search.

    Attributes
    ----------
    limits : Limits
        Those of all tendons; `allowed` are those with what the targets do not let pull held.
    statement : Statement
        Its mode, scheme and mesh are chosen as the search goes on.
    accuracy : float
        What residuals are held to, over the arm's length.
    machine_code : bool
        Whether to work by compiled kernels.
    starts : int or None
        Initial guesses that are tried, as far as so many differ; unless given, until enough of them
        agree, `MOST` at most.
    """

    arm: Arm
    targets: tuple[Target, ...]
    scene: Scene
    limits: Limits
    statement: Statement
    accuracy: float
    machine_code: bool = False
    starts: int | None = None

    @property
    def most(self) -> int:
        """How many initial guesses are made at most."""
        return MOST if self.starts is None else self.starts

    @property
    def simple(self) -> Task:
        """The same in the paper's balance and without loads, where strains are closed forms."""
        kept = (Extension, PrintedStatics)
        effects = (effect for effect in self.scene.effects if isinstance(effect, kept))
        return replace(self, scene=Scene(*effects))

    def held(self, floor: float) -> Task:
        """Return the same with the least stable mode held to the margin, and to a floor."""
        return replace(self, statement=self.statement.but(modes=1, floor=floor))

    @cached_property
    def allowed(self) -> Limits:
        """The limits, with tendons that a target does not let pull held at their minima."""
        return allowed(self.arm, self.targets, self.limits)

    def problem(self, statement: Statement) -> Problem:
        """Return the program by a statement."""
        if statement not in self._problems:
            stated = (self.arm, self.targets, self.scene, statement, self.machine_code)
            self._problems[statement] = build(*stated)
        return self._problems[statement]

    @cached_property
    def _problems(self) -> dict[Statement, Problem]:
        """The programs that were asked for."""
        return {}

    def coarse(self, mode: Mode) -> Statement:
        """Return the statement by a scheme and mesh that cost little: good to 1e-3 of L or so."""
        return self._coarse.but(mode=mode) if mode != "exact" else self._coarse

    @cached_property
    def _coarse(self) -> Statement:
        """The same for targets that are met.

        Without extension a slender tip winds up further, and takes a finer mesh.
        """
        if self.scene.has(PrintedStatics):
            scheme, refinement = "rk4", 2
        else:
            scheme, refinement = self.fine_scheme, 1 if self.scene.has(Extension) else 2
        form: Form = self.statement.form if self.statement.wound else "condensed"
        return self.statement.but(mode="exact", form=form, scheme=scheme, refinement=refinement)

    def finer(self, mode: Mode) -> Statement:
        """Return the statement for a search where the coarse mesh misled."""
        return self.statement.but(mode=mode, scheme=self.fine_scheme, refinement=2)

    @property
    def fine_scheme(self) -> str:
        """The scheme on which a plan is finished."""
        return "rk6" if self.scene.has(PrintedStatics) else "gauss6"

    @property
    def is_point(self) -> bool:
        """Whether no more is to be met than a point has numbers, and nothing kept above 0."""
        terms = self.problem(self.coarse("exact")).terms
        return bool(self._rows <= 3 and terms.numel_out(2) == 0)

    @cached_property
    def can_be_exact(self) -> bool:
        """Whether there are tendons enough to meet every equality and soft residual."""
        free = np.sum(np.array(self.allowed.upper) > self.allowed.lower)
        return bool(self._rows <= free)

    @cached_property
    def _rows(self) -> int:
        terms = self.problem(self.coarse("exact")).terms
        return int(terms.numel_out(0) + terms.numel_out(1))

    def tensions(self, solution: Solution) -> Array:
        """Return the tensions of a solution, of whatever statement (n_tendons,) [N]."""
        return self.problem(self.coarse("exact")).tensions(solution.x, self.allowed)


def allowed(arm: Arm, targets: tuple[Target, ...], limits: Limits) -> Limits:
    """Return the limits, with tendons that a target does not let pull held at their minima."""
    tendons = frozenset.intersection(*(target.tendons(arm) for target in targets))
    return limits.restricted(tendons)
