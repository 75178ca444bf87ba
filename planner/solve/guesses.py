"""Initial guesses: tensions fitted to the targets, the straight arm, drawn arms that are near.

Arms are drawn by the bends of their sections and looked at all together, on the coarsest mesh, in a
scene without loads whose strains are closed forms. Where a target prescribes turns, directions or
several points, each section's bend is as good as given, but not in closed form: tendons of the
sections beyond bend a section too, and an arm may wind up in many ways. So those that are nearest
to what is wanted are driven to it by least squares, with as little effort as it takes nearby. What
is met in several ways is met by several of them. For a point, which arms meet in many ways that go
over into each other, the straight arm and drawn ones do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.effects import Extension
from octoplan.model.integrators import MAGNUS4
from octoplan.model.paths import Array
from octoplan.model.support.machine.functions import BatchFunction
from octoplan.model.support.progress import check_time
from octoplan.model.unloaded.closed_form import ClosedForm
from octoplan.planner.limits import NATURAL_RANGE, Limits, natural_tensions
from octoplan.planner.nlp_solution import NlpSolution
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.problem import factorised, tension_scales
from octoplan.planner.targets.target_set import TargetTerms

# How many conditions a point is, which arms meet in many ways.
POINT = 3
# Arms that are drawn; drawn to be fitted; and those of these that are fitted, in so many steps, the
# best third in as many more.
_DRAWN, _TO_FIT, _FITTED, _STEPS = 200, 4000, 80, 6
# Roots of how hard sections are squeezed at first: more is found from a little than from none.
_SQUEEZED = 0.1
# What the largest unit of tension counts beside residuals in a fit, for all tendons alike as in the
# objective: so much that fits come to shapes of little effort that all but meet the targets. A fit
# that does not fall by more than such a part in a step has come to its end.
_EFFORT, _END = 0.2, 3e-2
# Guesses differ by more than this part: fitted ones of the largest of their tensions, drawn ones of
# the root of the sum of squares.
_APART, FAR_APART = 0.3, 0.5
# Drawn arms before the straight one, and before those with so many times the pull: what an arm may
# take with its loads of what bends it without.
_FIRST, _STRONGER = 3, 3.0
# How many sections bend in a draw: where many do, each its own way, the arm pulls against itself.
_TOGETHER = 3
# Bends at the base and at the tip, in units of what bends the arm by about 1 rad. A slender tip
# takes many: it saturates. The best plans for poses and fetches of a slender arm are between these.
_LEAST, _MOST = (0.5, 0.2), (60.0, 4.0)

# Steps from an optimum of least squares to guesses for another one beside it, over the range of
# tensions; smaller ones lead back to it. Relative singular value below which the shape does not
# change at all.
_ASIDE, _UNSEEN = 0.3, 1e-6


def initial_guesses(
    task: PlanningProblem, loaded: bool = False, missed: bool = False
) -> Iterator[Array]:
    """Yield tensions (n_tendons,) [N] within limits: fitted ones, drawn ones, the straight arm's.

    Fitted ones come by effort and nearness, by nearness alone where targets are `missed`. Drawn
    ones come by how near they are to what the targets want. Of an arm that is `loaded` some come
    again with more pull.
    """
    limits, count = task.allowed, task.target_set.conditions
    # All tendons pull a little, inside of the limits.
    straight = np.clip(5e-3 * tension_scales(task.arm, limits), limits.lower, limits.upper)
    if count > POINT:
        yield from fitted(task, 0.0 if missed else _EFFORT)
    # A bend in a plane is met by arms that wind round once more, too, and more cheaply by those
    # next to the straight one.
    if count < POINT:
        yield straight
    for k, T in enumerate(drawn_arms(task)):
        yield T
        if k == _FIRST and count >= POINT:
            yield straight
        if k >= _FIRST and loaded:
            yield np.clip(_STRONGER * T, limits.lower, limits.upper)


def beside(near: NlpSolution) -> Iterator[Array]:
    """Yield tensions (n_tendons,) [N] beside an optimum, along what its targets see least first.

    Its program has equalities. Changes of the tensions that they do not see at all are left out.
    """
    problem = near.problem
    arm, limits, n = problem.arm, problem.limits, problem.arm.n_tendons
    span = NATURAL_RANGE * natural_tensions(arm)
    J = near.derivatives[2].tocsc()
    program = problem.program
    m, equalities, first = program.n_design_rows, program.equality_rows, program.states.start
    by_tensions = -factorised(J[m:, first:]).solve(J[m:, :n].toarray())
    target_rows = J.tocsr()[equalities].tocsc()
    seen = target_rows[:, :n].toarray() + target_rows[:, first:] @ by_tensions
    _, values, directions = np.linalg.svd(seen * span / problem.unit, full_matrices=False)
    for value, direction in zip(values[::-1], directions[::-1], strict=True):
        if value > _UNSEEN * values[0]:
            for step in (_ASIDE, -_ASIDE):
                T = near.tensions + step * span * direction
                yield np.clip(T, limits.lower, limits.upper)


def drawn_arms(task: PlanningProblem) -> Iterator[Array]:
    """Yield drawn tensions that differ: by nearness and effort, and by nearness alone, in turn.

    Without a look at the time, of which they take little.
    """
    unit = tension_scales(task.arm, task.allowed)
    bends = BendCoordinates(task.arm, task.target_set.tendons, task.allowed)
    drawn = bends.tensions(bends.draw(_DRAWN))
    distance = np.linalg.norm(residuals_of(task)(drawn), axis=1)
    # What a unit of tension counts beside how near an arm is.
    cheap = distance + 0.2 * np.linalg.norm(drawn / unit, axis=1)
    orders = np.argsort([cheap, distance], axis=1, kind="stable")
    yield from distinct(drawn[np.ravel(orders, "F")], unit, FAR_APART)


def fitted(task: PlanningProblem, effort: float) -> Iterator[Array]:
    """Yield tensions (n_tendons,) fitted to targets and to little effort, the best fits first.

    `effort` is its weight beside residuals. Where sections shorten, how hard all tendons of a
    section pull is fitted beside its bends.
    """
    bends = BendCoordinates(task.arm, task.target_set.tendons, task.allowed)
    unit, residuals = tension_scales(task.arm, task.allowed).max(), residuals_of(task)
    # Of least squares a near miss with less effort is no better guess.
    weight = 0.0 if task.target_set.terms.names[1] else effort

    def gaps(points: Array) -> Array:
        T = bends.tensions(points)
        return np.hstack([residuals(T), weight * T / unit])

    points = bends.draw(_TO_FIT)
    off = np.linalg.norm(residuals(bends.tensions(points)), axis=1)
    points = points[np.argsort(off, kind="stable")[:_FITTED]]
    if task.scene.has(Extension):
        points = np.hstack([points, np.full((len(points), bends.width // 2), _SQUEEZED)])
    points, r = least_squares(gaps, points)
    best = np.argsort(np.linalg.norm(r, axis=1), kind="stable")[: _FITTED // 3]
    points[best], r[best] = least_squares(gaps, points[best])
    T = bends.tensions(points[np.argsort(np.linalg.norm(r, axis=1), kind="stable")])
    yield from distinct(T, np.ones(T.shape[1]), _APART, np.inf)


def distinct(
    tensions: Iterable[Array], unit: Array, part: float, norm: float = 2
) -> Iterator[Array]:
    """Yield the tensions that differ from all previous ones by more than a part of their norm."""
    taken = np.zeros((0, unit.size))
    for T in tensions:
        apart = np.linalg.norm((taken - T) / unit, norm, axis=1)
        if np.all(apart > part * np.linalg.norm(T / unit, norm)):
            taken = np.vstack([taken, T])
            yield T


def least_squares(gaps: Callable[[Array], Array], U: Array) -> tuple[Array, Array]:
    """Return points (m, n) of least squares of gaps near U, and the gaps there (m, k).

    Gaps are a function of points (m, n) -> (m, k). All that still come nearer take the steps of
    Levenberg and Marquardt's method side by side; derivatives at a point come in one call with its
    gaps.
    """
    U, damping, left = U.copy(), np.full(len(U), 1e-2), np.arange(len(U))
    r, J = _linearised(gaps, U)
    for _ in range(_STEPS):
        check_time()
        if not left.size:
            break
        normal = J[left] @ J[left].transpose(0, 2, 1)
        # Less than rounding does not keep a system from being singular.
        least = damping[left] + 1e-12 * np.trace(normal, axis1=1, axis2=2)
        normal += least[:, None, None] * np.eye(U.shape[1])
        step = -np.linalg.solve(normal, J[left] @ r[left, :, None])[:, :, 0]
        trial = U[left] + np.clip(step, -1, 1) * (1 + np.abs(U[left]))
        r_trial, J_trial = _linearised(gaps, trial)
        before, after = (np.linalg.norm(each, axis=1) for each in (r[left], r_trial))
        better = after < before
        taken = left[better]
        U[taken], r[taken], J[taken] = trial[better], r_trial[better], J_trial[better]
        damping[left] = np.maximum(damping[left] * np.where(better, 0.2, 8.0), 1e-8)
        left = left[~better | (after < (1 - _END) * before)]
    return U, r


def _linearised(gaps: Callable[[Array], Array], U: Array) -> tuple[Array, Array]:
    """Return gaps (m, k) and their derivatives (m, n, k) by U (m, n), by scaled differences."""
    (m, n), difference = U.shape, 1e-4
    shifts = np.vstack([np.zeros(n), difference * np.eye(n)])
    shifted = U[:, None, :] + shifts * (1 + np.abs(U))[:, None, :]
    values = gaps(shifted.reshape(-1, n)).reshape(m, n + 1, -1)
    return values[:, 0].copy(), (values[:, 1:] - values[:, :1]) / difference


def residuals_of(task: PlanningProblem) -> Callable[[Array], Array]:
    """Return tensions (m, n_tendons) [N] -> their residuals (m, k), in the scene without its loads.

    Those of the targets, violations of inequalities, and last by how much the arm is crushed.
    Stiffness is left out: compliances are taken to be those that are wanted.
    """
    targets, at = task.target_set, task.target_set.stations
    forward = ClosedForm(task.arm, task.unloaded_scene, MAGNUS4, 1, at, task.machine_code)
    nodes, gaps_of = [forward.mesh.node(s) for s in at], _residuals_of(targets.terms)

    def residuals(tensions: Array) -> Array:
        poses, stretch = forward.many(tensions, nodes)
        numbers = np.tile(targets.numbers, (len(tensions), 1))
        (gaps,) = gaps_of(poses.reshape(len(tensions), -1), numbers)
        gaps = np.hstack([gaps, 10 * np.maximum(0.05 - stretch, 0.0)[:, None]])
        return np.where(np.isfinite(gaps), gaps, np.nan)

    return residuals


@lru_cache(maxsize=16)
def _residuals_of(terms: TargetTerms) -> BatchFunction:
    """Return (poses (7 K,), target numbers) -> residuals (k,), as one list of instructions."""
    poses, numbers = (ca.MX.sym("given", *terms.function.size_in(i)) for i in range(2))
    wanted = ca.vertcat(ca.DM(0, 1), *(ca.vec(ca.DM.eye(each.width)) for each in terms.requests))
    equality, soft_residual, inequality, _ = terms.function(poses, numbers, wanted)
    gaps = ca.densify(ca.vertcat(equality, soft_residual, ca.fmin(inequality, 0)))
    function = ca.Function("gaps", [poses, numbers], [gaps])
    arguments = function.sx_in()
    return BatchFunction(ca.Function("gaps", arguments, function.call(arguments), {"cse": True}))


def many_places(task: PlanningProblem, tensions: Array) -> tuple[Array, Array]:
    """Return places (m, K, 3) of an arm under tensions (m, n_tendons), and their arc lengths (K,).

    Without its loads.
    """
    forward = ClosedForm(task.arm, task.unloaded_scene, MAGNUS4, 4, (), task.machine_code)
    poses, _ = forward.many(tensions, range(1, forward.mesh.steps + 1))
    return poses[..., 4:], forward.mesh.s[1:]


def within_total(tensions: Array, limits: Limits) -> Array:
    """Return tensions (m, n_tendons), scaled down to the limit of the total pull if there is one.

    Tensions above their lower limits are scaled alike.
    """
    if limits.total is None:
        return tensions
    low = np.array(limits.lower)
    most = max(limits.total - float(low.sum()), 0.0)
    above = tensions - low
    share = most / above.sum(axis=1).clip(max(most, 1e-300))
    return np.asarray(low + above * share[:, None])


class BendCoordinates:
    """The pulls of the sections as a function of their bends, and of how hard they are squeezed.

    Sections are those with tendons that may pull, tip first; `width` is how many bends there are,
    two of each.
    """

    def __init__(self, arm: Arm, tendons: frozenset[int], limits: Limits) -> None:
        self._limits = limits
        phi, unit = np.array([angle for _, angle in arm.tendons]), natural_tensions(arm)
        section, pulls = np.array([i for i, _ in arm.tendons]), np.array(sorted(tendons))
        sections = np.unique(section[pulls])
        self.width = 2 * sections.size
        of_section = np.isin(np.arange(arm.n_tendons), pulls) & (section == sections[:, None])
        # Tensions (2 n, 2, n_tendons) that bend each section by about 1 rad along an axis, there
        # and back: the tendons on that side share the pull as the law of section 6.1 has it for
        # four of them.
        axes = np.array([[0.0, np.pi], [np.pi / 2, -np.pi / 2]])
        sides = np.exp(1j * (phi - axes[:, :, None]))
        shares = of_section[:, None, None] * np.maximum(sides.real, 0.0)
        reach = np.abs((shares * sides).sum(axis=-1, keepdims=True))
        self._sides = (shares * unit / np.where(reach > 0, reach, 1.0)).reshape(-1, 2, phi.size)
        # Tensions (n, n_tendons) by which all tendons of a section pull.
        self._squeezes = of_section * unit

    def tensions(self, bends: Array) -> Array:
        """Return tensions (m, n_tendons) of bends (m, 2 n), within the limits.

        Of bends and roots of squeezes if they are (m, 3 n).
        """
        bends, squeezes = bends[:, : self.width], bends[:, self.width :]
        T = np.maximum(bends, 0) @ self._sides[:, 0] + np.maximum(-bends, 0) @ self._sides[:, 1]
        if squeezes.size:
            T += squeezes**2 @ self._squeezes
        T = np.clip(T, self._limits.lower, self._limits.upper)
        return within_total(T, self._limits)

    def draw(self, count: int) -> Array:
        """Return bends (count, 2 n) in all directions, as many small as large; always the same.

        In each draw a few sections bend, the others are straight.
        """
        rng, n = np.random.default_rng(0), self.width // 2
        low, high = np.geomspace(*_LEAST, n), np.geomspace(*_MOST, n)
        size = low * (high / low) ** rng.uniform(size=(count, n))
        angle = rng.uniform(0, 2 * np.pi, size=(count, n))
        size[rng.uniform(size=(count, n)).argsort(axis=1) >= _TOGETHER] = 0.0
        bends = np.stack([size * np.cos(angle), size * np.sin(angle)], axis=2)
        return np.asarray(bends.reshape(count, -1))
