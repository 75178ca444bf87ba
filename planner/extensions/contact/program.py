"""Programs in the tensions of an arm in contact: its shape is settled, contacts sharp, for each.

    minimise    sum T^2 / 2
    subject to  equalities = 0, inequalities >= 0     of the targets, at the shape x(T)
                forces on each object that is held balance its wrench, tangential ones f in cones:
                n . f = 0, |f| <= mu N
                the least eigenvalue of the energy's Hessian >= a margin, where that is asked for
                lower <= T <= upper, sum T <= total pull

By the exact penalty of the violations' norm in a trust region, which steps over kinks where places
come and go (Fletcher, Practical Methods of Optimization, 1987, section 14.3). The shape's
derivatives are by the implicit function theorem; each step is a conic program, in which tangential
forces are unknowns within their cones. If constraints cannot be met, their violation is minimised.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import clarabel
import numpy as np

from octoplan.model.equilibrium.linearised import Equilibrium, check_stretch
from octoplan.model.equilibrium.modes import stability, stability_slope
from octoplan.model.equilibrium.stability import is_stable
from octoplan.model.extensions.contact.effects import contacts
from octoplan.model.extensions.contact.forward import TouchingMap
from octoplan.model.extensions.contact.term import contact_places
from octoplan.model.extensions.contact.touches import (
    ContactFlags,
    Place,
    Places,
    forces,
    places_of,
    resultants,
)
from octoplan.model.paths import Array
from octoplan.model.rotations import POSE
from octoplan.model.support.errors import SnapError, UnsettledContactError
from octoplan.model.support.progress import check_time
from octoplan.planner.extensions.conic import Cone, conic_program
from octoplan.planner.extensions.contact.grasp import COST, Grasp
from octoplan.planner.extensions.contact.hold import Hold
from octoplan.planner.extensions.contact.load_path import LoadPath, path_sensitivities, rubs
from octoplan.planner.limits import natural_tensions
from octoplan.planner.planning_problem import PlanningProblem

# Step of differences of states, in scaled tensions.
_STEP = 1e-6
# Step of differences of settled shapes, in scaled tensions.
_CHANGE = 1e-5


@dataclass(frozen=True, eq=False)
class Constraints:
    """Constraints at an equilibrium, linearised in scaled tensions (n,).

    Attributes
    ----------
    point : Equilibrium
    tensions : (n,)
        Scaled.
    room : (2, n)
        Distances from the upper and from the lower bounds.
    equal, unequal : (m, 1 + n)
        Values of equalities (= 0) and inequalities (>= 0), then the derivatives. The first
        inequality is the stability margin, if there is one.
    grasp : Grasp
        The grasp of all held objects.
    grasp_rates : (m, n)
        Derivatives of wrenches, bounds and columns of the grasp.
    tangential : (2 k,)
        Tangential forces of the linearisation, along the bases of the grasp.
    region : (q, 1 + n)
        Further inequalities (>= 0) within which the linearisation holds; see kinks.py.
    """

    point: Equilibrium
    tensions: Array
    room: Array
    equal: Array
    unequal: Array
    grasp: Grasp
    grasp_rates: Array
    tangential: Array
    region: Array = field(default_factory=lambda: np.zeros((0, 1)))

    @cached_property
    def numbers(self) -> Array:
        """The values of constraints and grasp, then their derivatives (m, 1 + n)."""
        grasp = self.grasp
        values = np.concatenate([grasp.still, grasp.most, grasp.columns.ravel()])
        return np.vstack([self.equal, self.unequal, np.column_stack([values, self.grasp_rates])])

    def with_numbers(self, numbers: Array, region: Array) -> Constraints:
        """Return the linearisation with other numbers, and the region in which it holds."""
        grasp = self.grasp
        ends = np.cumsum([len(self.equal), len(self.unequal), grasp.still.size, grasp.most.size])
        equal, unequal, still, most, columns = np.split(numbers, ends)
        changed = replace(
            grasp,
            still=still[:, 0],
            most=most[:, 0],
            columns=columns[:, 0].reshape(grasp.columns.shape),
        )
        return replace(
            self,
            equal=equal,
            unequal=unequal,
            grasp=changed,
            grasp_rates=numbers[ends[1] :, 1:],
            region=region,
        )

    @cached_property
    def violation(self) -> float:
        """The norm of all violations, with the best tangential forces."""
        short = np.minimum(self.unequal[:, 0], 0.0)
        return float(np.linalg.norm(np.concatenate([self.equal[:, 0], short, self.grasp.least])))

    def merit(self, penalty: float) -> float:
        """Return half of the squared norm of scaled tensions, and the penalty of the violation."""
        return float(self.tensions @ self.tensions) / 2 + penalty * self.violation

    @cached_property
    def cones(self) -> list[Cone]:
        """The linearised constraints, as cones of unknowns.

        These are changes of tensions, tangential forces, slacks of inequalities, the violation.
        """
        n, k, q = self.tensions.size, self.tangential.size, len(self.unequal)
        T, f, slack, t = np.split(np.eye(n + k + q + 1), np.cumsum([n, k, q]))
        still, most = self.grasp.still, self.grasp.most
        ends = np.cumsum([still.size, most.size])
        by_still, by_most, by_columns = np.split(self.grasp_rates, ends)
        by_wrench = by_still + self.tangential @ by_columns.reshape(still.size, k, n)
        wrench = by_wrench @ T + self.grasp.columns @ f
        values = [np.zeros(1), self.equal[:, 0], still, np.zeros(q)]
        left = np.vstack([t, self.equal[:, 1:] @ T, wrench, slack]), np.concatenate(values)
        cones: list[Cone] = [
            (clarabel.NonnegativeConeT, self.unequal[:, 1:] @ T + slack, self.unequal[:, 0]),
            (clarabel.SecondOrderConeT, *left),
        ]
        for i, bound in enumerate(most):
            rows = np.vstack([by_most[i] @ T, f[2 * i : 2 * i + 2]])
            cones.append((clarabel.SecondOrderConeT, rows, np.array([bound, 0.0, 0.0])))
        return cones

    @property
    def violated(self) -> slice:
        """The places, among the multipliers of a step, of the rows whose violation has a norm."""
        first = 2 * self.tensions.size + len(self.unequal) + 1
        count = len(self.equal) + self.grasp.still.size + len(self.unequal)
        return slice(first, first + count)

    @property
    def by_tensions(self) -> Array:
        """The rows of the cones against tensions (m, n)."""
        return np.vstack([rows[:, : self.tensions.size] for _, rows, _ in self.cones])

    def step(
        self, hessian: Array, radius: Array, penalty: float
    ) -> tuple[Array, Array, Array, float]:
        """Return the step of least merit in a trust region (n,), for a Hessian of the Lagrangian.

        Returns the change of the scaled tensions (n,), the new tangential forces (2 k,), the
        multipliers and the remaining violation. Multipliers are those of the upper and lower bounds
        (2 n,), then those of the cones and of the region; the multiplier of the violation, which is
        the penalty, is set to 0. Raises UnsettledContactError if no step is found.
        """
        n, k, size = self.tensions.size, self.tangential.size, self.cones[0][1].shape[1]
        T, f, (*_, t) = np.split(np.eye(size), [n, n + k])
        bounds = np.minimum(self.room, radius).ravel()
        limits = (clarabel.NonnegativeConeT, np.vstack([-T, T]), bounds)
        H, cost = T.T @ hessian @ T + COST * f.T @ f, T.T @ self.tensions + penalty * t
        cones = [limits, *self.cones]
        if self.region.size:
            rows = self.region[:, 1:] @ T
            cones.append((clarabel.NonnegativeConeT, rows, self.region[:, 0]))
        solution = conic_program(H, cost, cones)
        if solution is None:
            raise UnsettledContactError(1.0, "no step is found")
        x, lam = solution
        lam[2 * n + len(self.unequal)] = 0.0
        return x[:n], x[n : n + k], lam, float(x[-1])


class TensionProgram:
    """The program of a problem in scaled tensions, on a mesh of a refinement.

    Attributes
    ----------
    map : TouchingMap
        Tensions to equilibria.
    unit : float
        Unit of tensions [N].
    least : float
        Lower bound of the stability; 0 for no bound.
    refinement : int
        Refinement of the mesh.
    begin : Equilibrium or None
        With friction, the equilibrium at the end of the load path.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        refinement: int,
        least: float = 0.0,
        load_path: LoadPath = (),
    ) -> None:
        self.problem, self.least, self.refinement = problem, least, refinement
        self._stations = problem.target_set.stations
        self.map = TouchingMap(
            problem.arm, problem.scene, refinement, self._stations, problem.machine_code
        )
        self.unit, self.n = float(natural_tensions(problem.arm).max()), problem.arm.n_tendons
        self.holds = [target for target in problem.targets if isinstance(target, Hold)]
        self._terms, self._numbers = problem.target_set.terms, problem.target_set.numbers
        self._counts = self._terms.count, len(self._terms.names[2])
        self.begin = self.along(load_path) if rubs(problem.scene) else None

    def with_wrenches(self, share: float) -> TensionProgram:
        """Return the program for a share of all wrenches on held objects."""
        result = copy.copy(self)
        result.holds = [
            replace(hold, wrench=tuple(share * x for x in hold.wrench)) for hold in self.holds
        ]
        return result

    def settled(self, tensions: Array, near: Equilibrium | None = None) -> Equilibrium:
        """Return the equilibrium from rest, or near another; raises the errors of settling."""
        point = self.map.solve(tensions) if near is None else self.map.beside(near, tensions)
        if point is None:
            raise UnsettledContactError(1.0, "none is found next to another")
        check_stretch(point)
        return point

    def along(self, load_path: LoadPath) -> Equilibrium:
        """Return the equilibrium at the end of a load path; raises the errors of settling.

        Friction acts beyond the first tensions.
        """
        first, *others = (np.array(T) for T in load_path)
        point: Equilibrium = self.map.without_friction.solve(first)
        for T in others:
            check_time()
            point = self.settled(T, point)
        return point

    def at(
        self, tensions: Array, near: Equilibrium, tangential: Array | None = None
    ) -> Constraints:
        """Return the constraints at scaled tensions, near an equilibrium.

        The linearisation is at given tangential forces; at the best forces if none are given, or if
        the set of contacts changes. Raises the errors of settling.
        """
        allowed = self.problem.allowed
        lower, upper = np.array(allowed.lower), np.array(allowed.upper)
        # Steps are within limits to the rounding of the conic program.
        T = np.clip(self.unit * tensions, lower, upper)
        tensions, room = T / self.unit, np.stack([upper - T, T - lower]) / self.unit
        point, by_tensions = self._equilibrium_near(T, near)
        steps = _STEP * self.unit * by_tensions.T
        grasp, values = self._residuals(point)(np.vstack([0 * point.states, steps, -steps]))
        ahead, behind = np.split(values[1:], 2)
        rows = np.column_stack([values[0], (ahead - behind).T / (2 * _STEP)])
        equal, unequal, grasped = np.split(rows, np.cumsum(self._counts))
        if self.least or self.begin is None:
            unequal = np.vstack([self._margin(point, tensions), unequal])
        if allowed.total is not None:
            left = allowed.total / self.unit - tensions.sum()
            unequal = np.vstack([unequal, np.append(left, np.full(self.n, -1.0))])
        f = tangential
        if f is None or f.size != 2 * grasp.most.size:
            f = grasp.best
        return Constraints(point, tensions, room, equal, unequal, grasp, grasped[:, 1:], f)

    def _equilibrium_near(self, tensions: Array, near: Equilibrium) -> tuple[Equilibrium, Array]:
        """Return the equilibrium near another, and the derivatives (n_states, n_tendons) of states.

        With friction, the arm moves in a straight line of tensions from the begin, and friction
        acts against this motion. Without friction, the derivatives treat points without force as
        free.
        """
        if self.begin is not None:
            end = self.map.solve(tensions, self.begin, jumps=False)
            return end, path_sensitivities(end.path)
        point = self.settled(tensions, near)
        touches, force = ContactFlags.of(point.system), forces(point.system, point.states)
        light = touches.points & (force <= _STEP * self.unit)
        touches.flags[light] = 0
        released = Equilibrium(touches.on(point.system), point.x) if light.any() else point
        return point, released.by_tensions

    def _residuals(self, point: Equilibrium) -> Callable[[Array], tuple[Grasp, Array]]:
        """Return a function from changes of the states (b, n_states) to the values (b, m) there.

        The function also returns the grasp of the first change. Values are residuals and
        inequalities of the targets, then the numbers of the grasp. Raises UnsettledContactError if
        the arm does not touch a held object.
        """
        system, arm = point.system, self.problem.arm
        nodes = system.layout.nodes[[system.mesh.node(s) for s in self._stations], :POSE]
        touches, bodies = ContactFlags.of(system), contacts(system.scene)
        which, step = np.nonzero(touches.touching), _STEP * arm.length
        s = system.mesh.s[which[0]]
        tangents = np.zeros((s.size, 3))
        if s.size:
            before, after = np.split(point.at(np.append(s - step, s))[0][:, 4:], 2)
            tangents = (after - before) / step * touches.moves[which][:, None]
        leans = [
            (hold, [bodies[j].obstacle == hold.obstacle for j in which[1]]) for hold in self.holds
        ]
        if not all(any(on) for _, on in leans):
            raise UnsettledContactError(1.0, "none is found in which the arm touches what it holds")

        positions = system.layout.nodes[which[0], 4:7]
        shifts = contact_places(system.layout).touches[which[0], which[1], 1]
        has_terms = any(self._counts)

        def at(changes: Array) -> tuple[Grasp, Array]:
            states = point.states + changes
            places = states[:, positions] + changes[:, shifts, None] * tangents
            pressed = resultants(system, states)[:, which[0], which[1]]
            touched = list[tuple[Array, Array]]()
            for hold, on in leans:
                flat = places[:, on].reshape(-1, 3)
                normals, gaps = hold.obstacle.gradient(flat), hold.obstacle.distance(flat)
                points = flat - gaps[:, None] * normals
                shape = len(states), -1, 3
                touched.append((points.reshape(shape), normals.reshape(shape)))
            grasps, rows = list[Grasp](), list[Array]()
            for i, each in enumerate(states):
                grasp = Grasp.joined(
                    [
                        Grasp.at(arm, hold, points[i], normals[i], pressed[i, on])
                        for (hold, on), (points, normals) in zip(leans, touched, strict=True)
                    ]
                )
                numbers = [grasp.still, grasp.most, grasp.columns]
                if has_terms:
                    terms = self._terms.dense(each[nodes].ravel(), self._numbers, np.zeros(0))
                    numbers = [*terms[:3], *numbers]
                grasps.append(grasp)
                rows.append(np.concatenate([np.ravel(number) for number in numbers]))
            return grasps[0], np.array(rows)

        return at

    def _margin(self, point: Equilibrium, tensions: Array) -> Array:
        """Return stability minus its bound, and the derivatives by the scaled tensions.

        Far above the bound the values do not matter. Raises SnapError if the arm is unstable.
        """
        if is_stable(point, 2 * self.least):
            return np.append(1.0, np.zeros(self.n))
        beyond = stability(point) - self.least
        if beyond < -self.least:
            raise SnapError(1.0, "it is unstable next to another equilibrium")
        places = places_of(point.system)
        if any(place.lies for place in places):
            return np.append(beyond, self._margin_differences(point, tensions))
        return np.append(beyond, self.unit * self._margin_slope(point, places))

    def _margin_slope(self, point: Equilibrium, places: Places) -> Array:
        """Return the derivatives of the stability by the tensions (n,) for contact at points.

        On a mesh that is constant, `stability_slope` is exact. The stability also depends on the
        nodes, which move with the contact points: this part is the difference for each point.
        """
        _, slope = stability_slope(point)
        touches = contact_places(point.system.layout).touches
        step = _STEP * self.problem.arm.length
        for i, place in enumerate(places):
            node = point.system.mesh.node(place.start)
            rate = point.by_tensions[touches[node, place.obstacle, 1]]
            if not rate.any():
                continue
            check_time()
            ends = list[float]()
            for s in (place.start + step, place.start - step):
                moved = (*places[:i], Place(place.obstacle, s, s), *places[i + 1 :])
                there = self.map.with_places(point, moved)
                if there is None:
                    raise UnsettledContactError(1.0, "none is found next to another")
                # Newton's step is too short to count, but the Jacobian depends on the shift.
                ends.append(stability(there.relinearised()))
            slope = slope + (ends[0] - ends[1]) / (2 * step) * rate
        return slope

    def _margin_differences(self, point: Equilibrium, tensions: Array) -> Array:
        """Return the derivatives of the stability (n,) by differences of settled shapes."""

        def at(step: Array) -> float:
            check_time()
            return stability(self.settled(self.unit * (tensions + step), point))

        rates = [(at(step) - at(-step)) / (2 * _CHANGE) for step in _CHANGE * np.eye(self.n)]
        return np.array(rates)
