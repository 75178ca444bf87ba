"""The program of a design: numbers of the arm, and the programs of all tasks, as one.

    minimise    the sum of the tasks' objectives
    subject to  the constraints of each task, its equations of equilibrium with numbers n(z)
                what can be made: room(z) >= 0,   0 <= z <= 1

with z the unknown numbers of the arm between their bounds, and for each task its tensions and
states; solved by ipopt. The equations are differentiated by their numbers n by CasADi. The numbers
are closed forms of z in NumPy (profiles, integrals over cross-sections, loads on nodes that move
along with the arm), for which nothing is solved: their own derivatives by z are differences.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from model.arm import Arm
from model.equilibrium.forward import STAGES, Collocation
from model.errors import InputError
from model.paths import Array
from model.scene import Scene
from model.time_limit import check_time
from model.transcription.neighbours import landmarks, moved_mesh
from model.transcription.system import System
from model.winches import least_compliance
from planner.fit.making import Making, Objective, Reach
from planner.fit.unknowns import Parameters
from planner.program.limits import Limits
from planner.program.problem import Bounds, Problem, build, units
from planner.program.statement import Statement
from planner.program.states import States
from planner.program.terms import stations_of
from planner.solve.ipopt import NEAR, WARM, Options, Solution, named, nlp_solver, solved
from planner.targets.base import Target

Targets = tuple[Target, ...]
# Of the meshes; the residual up to which a task counts as met here: plans are certified afresh.
_REFINEMENT, _MET = 2, 1e-7
# Steps of second differences of the numbers, between the bounds: they steer steps alone.
_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Optimum:
    """A local optimum.

    Attributes
    ----------
    values : (K,)
        Of the unknowns.
    tensions : (tasks, n_tendons)
        [N].
    steps : int
    missed : float
        The largest violation of a constraint, over the arm's length or in rad.
    objective : float
        Half the sum of squared tensions [N2], the mean logarithm of compliances over those of the
        given arm at rest, or with a minus the reach over the given arm's length.
    """

    values: Array
    tensions: Array
    steps: int
    missed: float
    objective: float

    @property
    def cost(self) -> tuple[float, float]:
        """What is compared: what is missed first."""
        return max(self.missed - _MET, 0.0), self.objective


class Program:
    """Tasks of an arm with unknown numbers; a reach is one task more, the last."""

    def __init__(
        self,
        parameters: Parameters,
        tasks: Sequence[Targets],
        limits: Limits,
        making: Making,
        objective: Objective = "effort",
    ) -> None:
        self.parameters, self.limits, self.making = parameters, limits, making
        self.arm, scene = parameters.built(parameters.start)
        self.tasks, self.weights = tuple(tasks), [1.0] * len(tasks)
        # What one unit of the objective is worth: tensions are counted in the largest unit.
        self.worth = float(units(self.arm, limits).max() ** 2) if objective == "effort" else 1.0
        if isinstance(objective, Reach):
            self.tasks, self.weights = (*tasks, (objective,)), [*[0.0] * len(tasks), 1.0]
        elif objective != "effort":
            self.tasks = tuple((*own, objective) for own in tasks)
            self.weights = [1 / len(tasks)] * len(tasks)
        stated = Statement(refinement=_REFINEMENT)
        self.problems = [build(self.arm, own, scene, stated) for own in self.tasks]
        self.K = len(parameters.unknowns)

    def system(self, i: int, arm: Arm, scene: Scene) -> System:
        """Return the equations of a task's arm, on nodes that move along with it."""
        of, targets = self.problems[i].forward.system, self.tasks[i]
        before = landmarks(of.arm, of.scene, stations_of(of.arm, targets))
        after = landmarks(arm, scene, stations_of(arm, targets))
        mesh = moved_mesh(of.mesh, before, after)
        return System(arm, scene, mesh, STAGES, of.of.form.loaded)

    def numbers(self, values: Array) -> list[Array]:
        """Return the numbers of each task's equations, and last what room is left to the making.

        Raises InputError where no such arm can be.
        """
        arm, scene = self.parameters.built(values)
        found, known = list[Array](), dict[Any, Array]()
        for i, (own, targets) in enumerate(zip(self.problems, self.tasks, strict=True)):
            key = (
                own.stations,
                own.requests,
                tuple(map(np.ndarray.tobytes, own.directions(targets))),
            )
            if key not in known:
                states = States(self.system(i, arm, scene), own.requests, least_compliance(arm))
                known[key] = states.numbers(own.directions(targets))
            found.append(known[key])
        return [*found, self.making.room(arm)]

    def given(self, i: int) -> Array:
        """Return the parameters of a task's program."""
        return self.problems[i].parameters(self.tasks[i], self.limits)

    def begun(self, values: Array, tensions: Array) -> Array:
        """Return the unknowns of an arm whose tasks are in equilibrium under tensions."""
        arm, scene = self.parameters.built(values)
        found, numbers = [self.parameters.shares(values)], self.numbers(values)
        for i, (own, T) in enumerate(zip(self.problems, tensions, strict=True)):
            p = self.given(i)
            p[own.program.parts.numbers] = numbers[i]
            states = Collocation.on(self.system(i, arm, scene)).found(T).states
            found.append(own.closed(own.free(T, self.limits), states, p))
        return np.concatenate(found)

    def solve(self, values: Array, tensions: Array, fixed: bool = False) -> Optimum:
        """Return the optimum that an arm and its plans lead to, numbers of the arm `fixed` or not.

        Or the best of all that were met on the way, where that is these themselves.
        """
        x, bounds, found = self._followed(values, tensions, fixed)
        first = self._optimum(x, 0, bounds)
        last = self._optimum(found.x, found.iterations, bounds)
        return min(last, first, key=lambda own: own.cost)

    def sensitivity(self, values: Array, tensions: Array) -> Array:
        """Return derivatives of the objective by the values (K,), all tensions chosen anew.

        They are the Lagrangian's, at the optimum of the tensions for an arm with these values.
        """
        _, _, found = self._followed(values, tensions, fixed=True)
        of = self.stated.derivatives
        _, gradient = of["grad_f"](found.x, 0.0)
        _, J = of["jac_g"](found.x, 0.0)
        slopes = np.array(gradient + J.T @ ca.DM(found.lam_g)).ravel()[: self.K]
        return np.asarray(self.worth * slopes / self.parameters.range)

    def _followed(
        self, values: Array, tensions: Array, fixed: bool
    ) -> tuple[Array, Bounds, Solution]:
        """Return the unknowns of an arm and its plans, the bounds, and what ipopt makes of them."""
        own = [*tensions, tensions[0]][: len(self.tasks)]
        x = self.begun(values, np.array(own))
        lower, upper = (np.full(self.K, end) for end in (0.0, 1.0))
        if fixed:
            lower = upper = x[: self.K]
        tasks = [own.bounds(self.limits) for own in self.problems]
        room = self.making.room(self.arm).size
        bounds = (
            np.concatenate([lower, *(own[0] for own in tasks)]),
            np.concatenate([upper, *(own[1] for own in tasks)]),
            np.concatenate([*(own[2] for own in tasks), np.zeros(room)]),
            np.concatenate([*(own[3] for own in tasks), np.full(room, np.inf)]),
        )
        found = self._solved(NEAR, x, bounds)
        if found.finite:
            found = self._solved(WARM, found.x, bounds, (found.lam_x, found.lam_g))
        return x, bounds, found

    def _optimum(self, x: Array, steps: int, bounds: Bounds) -> Optimum:
        f, g = (np.array(self.stated.derivatives[name](x, 0.0)[0]) for name in ("grad_f", "jac_g"))
        off = np.concatenate([bounds[2] - g.ravel(), g.ravel() - bounds[3], [0.0]]).max()
        values = self.parameters.from_shares(np.clip(x[: self.K], 0.0, 1.0))
        T, start = [], self.K
        for own in self.problems:
            T.append(own.tensions(x[start:], self.limits))
            start += own.program.size
        missed = float(off) if np.isfinite(off) else np.inf
        return Optimum(values, np.array(T), steps, missed, self.worth * float(f.item()))

    @cached_property
    def stated(self) -> Stated:
        """The program in symbols."""
        return stated(self)

    def _solved(self, way: Options, *given: Any) -> Solution:
        """Return what ipopt makes of unknowns, bounds, multipliers."""
        x, *more = given
        return solved(nlp_solver(*self.stated[:2], way), x, np.zeros(1), *more)


class Stated(NamedTuple):
    """The program in CasADi's symbols: x, p, f and g, and their derivatives by name.

    With the closed forms that these call, which CasADi does not keep.
    """

    nlp: dict[str, ca.MX]
    derivatives: dict[str, ca.Function]
    closed: ClosedForms


def stated(of: Program) -> Stated:
    """Return the program in symbols: blocks of the tasks, coupled by the columns of z."""
    K, closed = of.K, ClosedForms(of)
    sizes = [own.program.size for own in of.problems]
    cuts = np.cumsum([0, *map(len, of.numbers(of.parameters.start))]).tolist()
    room_size = cuts[-1] - cuts[-2]
    rows = [*(own.n_outer + own.program.blocks.n_rows for own in of.problems), room_size]
    x, lam = ca.MX.sym("x", K + sum(sizes)), ca.MX.sym("lam", sum(rows))
    none, sigma = ca.MX.sym("none"), ca.MX.sym("sigma")
    z, *xs = ca.vertsplit(x, np.cumsum([0, K, *sizes]).tolist())
    *lams, room_lam = ca.vertsplit(lam, np.cumsum([0, *rows]).tolist())
    all_numbers, all_slopes, curved = closed(z)
    *numbers, room = ca.vertsplit(all_numbers, cuts)
    *slopes, room_slopes = ca.vertsplit(all_slopes, cuts)
    tasks = [
        _task(own, of.given(i), of.weights[i], (xs[i], numbers[i], slopes[i]), (sigma, lams[i]))
        for i, own in enumerate(of.problems)
    ]
    f, gradient, g, by_x, by_z, in_x, across, in_z, weights = zip(*tasks, strict=True)
    both = ca.reshape(curved.T @ ca.vertcat(*weights, room_lam), K, K)
    J = ca.diagcat(*by_x), ca.MX(room_size, sum(sizes))
    J_z = ca.vertcat(*by_z, room_slopes)
    H = ca.horzcat(both + sum(in_z), ca.horzcat(*across))
    H_x = ca.horzcat(ca.MX(sum(sizes), K), ca.triu(ca.diagcat(*in_x)))
    nlp = {"x": x, "p": none, "f": ca.MX(sum(f)), "g": ca.vertcat(*g, room)}
    derivatives = named(
        (x, none, sigma, lam),
        (nlp["f"], ca.vertcat(ca.MX.zeros(K), *gradient)),
        (nlp["g"], ca.horzcat(J_z, ca.vertcat(*J))),
        ca.vertcat(ca.triu(H), H_x),
    )
    return Stated(nlp, derivatives, closed)


def _task(
    problem: Problem,
    p: Array,
    weight: float,
    at: tuple[ca.MX, ca.MX, ca.MX],
    weights: tuple[ca.MX, ca.MX],
) -> tuple[ca.MX, ...]:
    """Return a task's part at unknowns x, numbers n and their slopes by z.

    Objective and its gradient, constraints, their derivatives by x and by z, the Hessian in x,
    across (z by x) and in z for numbers that are linear in z, and the weights of numbers that are
    not. The equations see y = (unknowns in SI, n); the chain rule takes them to (x, z).
    """
    program, (x, numbers, slopes), (sigma, lam) = problem.program, at, weights
    own, equations, K = program.symbols, program.equations.in_numbers, slopes.size2()
    whole, scale = ca.DM(program.whole(p)), ca.DM(p[program.parts.row_scale])
    given, m, n = [own.x, own.p], own.outer.numel(), program.size
    first = [own.f, own.gradient, own.outer, own.outer_jacobian]
    f, gradient, outer, outer_J = ca.Function("outer", given, first)(x, ca.DM(p))
    given += [own.sigma, own.outer_lam]
    second = ca.Function("outer_hessian", given, [own.outer_hessian])
    outer_H = second(x, ca.DM(p), weight * sigma, lam[:m])
    y, none = ca.vertcat(whole * x, numbers), ca.MX(0, 1)
    chain = ca.diagcat(ca.MX(ca.diag(whole)), slopes)
    function, places = equations.jacobian
    J = ca.diag(1 / scale) @ ca.MX(places, function(y, none))
    function, places = equations.hessian
    H = chain.T @ ca.MX(places, function(y, none, lam[m:] / scale)) @ chain
    by_both = J @ chain
    return (
        weight * f,
        weight * gradient,
        ca.vertcat(outer, equations.value(y, none) / scale),
        ca.vertcat(outer_J, by_both[:, :n]),
        ca.vertcat(ca.MX(m, K), by_both[:, n:]),
        H[:n, :n] + outer_H,
        H[n:, :n],
        H[n:, n:],
        J[:, n:].T @ lam[m:],
    )


class ClosedForms(ca.Callback):
    """The numbers n(z) of a program as CasADi calls them: z -> n, dn/dz, d2n/dz2 (n, K K).

    None are numbers where no such arm can be, so that the solver shortens its step.
    """

    def __init__(self, of: Program) -> None:
        super().__init__()
        self._of, self._n = of, sum(map(len, of.numbers(of.parameters.start)))
        self._at = lru_cache(maxsize=2)(self._new)  # a step asks for them up to four times
        self.construct("closed_forms", {})

    def get_n_out(self) -> int:
        """Return how many matrices there are."""
        return 3

    def get_sparsity_in(self, _: int) -> ca.Sparsity:
        """Return that z is dense."""
        return ca.Sparsity.dense(self._of.K)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        """Return that all are dense."""
        return ca.Sparsity.dense(self._n, self._of.K**i)

    def eval(self, given: Sequence[ca.DM]) -> list[ca.DM]:
        """Return the matrices."""
        return self._at(tuple(np.array(given[0]).ravel().tolist()))

    def _new(self, z: tuple[float, ...]) -> list[ca.DM]:
        check_time()
        own, K, at = self._of.parameters, self._of.K, np.array(z)
        try:
            here = self._of.numbers(own.from_shares(at))
            parts = own.derivatives(self._of.numbers, here, own.from_shares(at))
            rows = np.concatenate(here), np.vstack(parts) * own.range, self._curved(at)
            return [ca.DM(row) for row in rows]
        except InputError:
            return [ca.DM.nan(self._n, K**i) for i in range(3)]

    def _n_of(self, z: Array) -> Array:
        return np.concatenate(self._of.numbers(self._of.parameters.from_shares(z)))

    def _curved(self, z: Array) -> Array:
        """Return second differences (n, K K), by steps away from the nearer bound."""
        here, steps = self._n_of(z), np.diag(np.where(z < 0.5, _STEP, -_STEP))
        beside = [self._n_of(z + step) for step in steps]
        found = np.zeros((here.size, *steps.shape))
        for i, j in combinations_with_replacement(range(len(steps)), 2):
            change = self._n_of(z + steps[i] + steps[j]) - beside[i] - beside[j] + here
            found[:, i, j] = found[:, j, i] = change / (steps[i, i] * steps[j, j])
        return found.reshape(here.size, -1)
