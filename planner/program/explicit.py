"""The program of a scene whose poses are an explicit function of the tensions.

Without loads each cross-section settles by itself; as printed, eqs. (10) and (11) are integrated
from the tip to the base. The tensions are the only unknowns of the mechanics. Closed forms are
derived step by step, by kernels that may be compiled; those as printed as a whole.
"""

from __future__ import annotations

import threading
from functools import cached_property, partial

import numpy as np

from model.arm import Arm
from model.effects import Extension, PrintedStatics
from model.equilibrium.forward import Known
from model.forward import explicit_map
from model.paths import Array
from model.scene import Scene
from model.stations import Counts
from model.unloaded.closed_form import ClosedForm
from model.unloaded.condensed_steps import CondensedSteps
from model.unloaded.steps_in_c import StepsInC
from planner.program.explicit_in_c import ExplicitInC
from planner.program.explicit_numbers import ExplicitByCasadi
from planner.program.expressions import Expressions, by_casadi, by_steps, outer_of
from planner.program.objective import Rows, objective_of
from planner.program.reduced import Reduced
from planner.program.statement import Statement
from planner.targets.base import Target

# By stages of the elements: as printed, and in closed form.
_PRINTED = {1: "rk4", 2: "rk4", 3: "rk6"}
_CLOSED = {1: "magnus2", 2: "magnus4", 3: "magnus6"}


class _Memory(threading.local):
    """What was found last, by each thread."""

    found: tuple[Array, Array, Reduced] | None = None


class Explicit:
    """Unknowns are tensions, peak, lack; parameters those of the objective, then the units."""

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        targets: tuple[Target, ...],
        statement: Statement,
        stations: tuple[float, ...],
        machine_code: bool = False,
    ) -> None:
        schemes = _PRINTED if scene.has(PrintedStatics) else _CLOSED
        mesh = (schemes[statement.stages], statement.refinement, stations)
        forward = explicit_map(arm, scene, *mesh)
        rows = _slimmest(arm, forward.stretch_at, forward.stretch_active) * scene.has(Extension)
        self.objective, n = objective_of(arm, targets, statement, len(rows)), arm.n_tendons
        self.n_free = n + self.objective.n_peak + self.objective.n_lack
        self.sizes = (self.objective.n_numbers, n)
        nodes = [forward.mesh.node(s) for s in stations]
        if isinstance(forward, ClosedForm):
            steps = CondensedSteps(forward, nodes, rows, machine_code)
            own = outer_of(self.objective, n, len(stations), machine_code)
            self._state = partial(by_steps, steps, own)
            if StepsInC.can(steps):
                self._calls = ExplicitInC(StepsInC(steps), own)
        else:
            self._state = partial(by_casadi, forward, self.objective, nodes, rows)
        self._last = _Memory()

    @cached_property
    def symbols(self) -> Expressions:
        """The program in symbols, as CasADi's solvers take it."""
        return self._state()

    @property
    def size(self) -> int:
        """How many unknowns there are."""
        return self.n_free

    @property
    def rows(self) -> tuple[Rows, ...]:
        """What the rows of the constraints are, in order."""
        return self.objective.rows

    @property
    def program(self) -> Explicit:
        """The program: what is explicit has no mechanics apart from it."""
        return self

    @property
    def condensed(self) -> Explicit:
        """The same: there are no states."""
        return self

    def numbers(self, target: Array) -> Array:
        """Return the parameters of the mechanics: none."""
        return np.zeros(0)

    @cached_property
    def _calls(self) -> ExplicitInC | ExplicitByCasadi:
        return ExplicitByCasadi(self.symbols)

    @property
    def in_c(self) -> ExplicitInC | None:
        """The program as other C calls it, where it is compiled."""
        return self._calls if isinstance(self._calls, ExplicitInC) else None

    def value(self, a: Array, p: Array) -> tuple[float, Array]:
        """Return objective and constraints."""
        return self._calls.value(a, p)

    def values(self, x: Array, p: Array) -> Array:
        """Return the constraints at unknowns x."""
        return self.first(x, p).g

    def multipliers(self, a: Array, p: Array, lam_x: Array, lam_g: Array) -> tuple[Array, Array]:
        """See Condensed.multipliers: there are no states."""
        return lam_x, lam_g

    def forget(self, near: Known | None = None) -> None:
        """See Condensed.forget: nothing is kept."""

    def lifted(self, a: Array, p: Array) -> Array:
        """See Condensed.lifted: there are no states."""
        return a

    def begin_at(self, x: Array, p: Array) -> None:
        """See Condensed.begin_at: nothing is kept."""

    def stay(self, here: Reduced, p: Array) -> None:
        """See Condensed.stay: nothing is kept."""

    @property
    def stands(self) -> bool:
        """See Condensed.stands: without loads nothing topples."""
        return True

    def apart(self) -> Explicit:
        """See Condensed.apart: there is no memory."""
        return self

    def first(self, a: Array, p: Array) -> Reduced:
        """See Condensed.first; what was asked last is remembered."""
        known = self._last.found
        if known and np.array_equal(known[0], a) and np.array_equal(known[1], p):
            return known[2]
        found = Reduced(a.copy(), *self._calls.first(a, p))
        self._last.found = found.x, p.copy(), found
        return found

    def at(self, x: Array, p: Array) -> Reduced:
        """See Condensed.at: there are no other unknowns."""
        return self.first(x, p)

    def curvature(self, here: Reduced, p: Array, sigma: float, lam: Array) -> tuple[Array, Array]:
        """See Condensed.curvature."""
        return self.second(here.x, p, sigma, lam), np.zeros(self.n_free)

    def follow(self, here: Reduced, change: Array, p: Array) -> Array:
        """See Condensed.follow."""
        return here.x + change

    def second(self, a: Array, p: Array, sigma: float, lam: Array) -> Array:
        """See Condensed.second."""
        return self._calls.second(a, p, sigma, lam)

    def stability(self, x: Array, tensions: Array, near: Known | None = None) -> float:
        """See Collocated.stability: nothing topples without loads."""
        return np.inf

    def is_from_rest(self, x: Array, tensions: Array) -> bool:
        """See Collocated.is_from_rest: there is one shape without loads."""
        return True

    def moved_by_loads(self, tensions: Array) -> float:
        """See Collocated.moved_by_loads: there are none."""
        return 0.0

    def unknowns(self, a: Array, tensions: Array, p: Array) -> Array:
        """Return all unknowns: those before the states, where there are none."""
        lack = self.objective.n_lack
        if lack:
            g = self.first(a, p).g
            a[self.n_free - lack :] = np.maximum(-g[self.objective.lack_rows], 0.0)
        return a


def _slimmest(arm: Arm, s: Array, active: Counts) -> list[int]:
    """Return, for each segment with tendons, where its body is slimmest and 1 + q least."""
    radius = arm.radius.evaluate(s, arm.length)[0]
    rows = []
    for count in np.unique(active[active > 0]):
        inside = np.flatnonzero(active == count)
        rows.append(int(inside[np.argmin(radius[inside])]))
    return rows
