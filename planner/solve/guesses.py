"""Initial guesses: tensions fitted to the targets, the straight arm, and random arms nearby.

Random arms are drawn by the bends of their sections. All draws are evaluated together, on the
coarsest mesh, in a scene without loads, whose strains are closed forms. For a point, which arms
meet in many connected ways, the straight arm and the nearest draws are the guesses. Targets that
prescribe turns, directions or several points almost determine the bend of each section, but not in
closed form: tendons of the sections beyond also bend a section, and an arm may wind up in many
ways. For such targets the nearest draws are fitted by least squares, with a small weight on effort,
and the distinct fits are the guesses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.effects.sections import Extension
from octoplan.model.equilibrium.explicit import ClosedForm
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import MAGNUS4
from octoplan.model.scene import Scene
from octoplan.model.support.progress import check_time
from octoplan.planner.limits import NATURAL_RANGE, TendonLimits, natural_tensions
from octoplan.planner.planning_problem import PlanningProblem
from octoplan.planner.program_instance import factorised, tension_scales
from octoplan.planner.solution import NlpSolution
from octoplan.planner.targets.target_set import TargetSet, residual_function

# Number of conditions of a point, which arms meet in many ways.
POINT = 3
# Number of draws for guesses that are not fitted.
_DRAWN = 200
# Number of draws for fits.
_TO_FIT = 4000
# Number of draws that are fitted: the nearest ones.
_FITTED = 80
# Number of steps of a fit. The best third of the fits takes as many steps again.
_STEPS = 6
# Initial roots of the squeezes of sections [-]. The derivative with respect to a zero root is zero.
_SQUEEZED = 0.1
# Weight of the largest unit of tension beside residuals in a fit, the same for all tendons as in
# the objective. With this weight fits have little effort and nearly meet the targets [-].
_EFFORT = 0.2
# Relative decrease per step below which a fit ends [-].
_END = 3e-2
# Smallest difference between fitted guesses, over the largest tension [-].
_APART = 0.3
# Smallest difference between drawn guesses, over the norm of the tensions [-].
FAR_APART = 0.5
# Index of the draw after which the straight arm follows, and from which stronger draws follow.
_FIRST = 3
# Factor of the tensions of a draw without loads for the guess of an arm under loads [-].
_STRONGER = 3.0
# Number of bent sections in a draw. If many sections bend in random directions, the tendons
# oppose each other.
_TOGETHER = 3
# Smallest bends of a draw at base and tip, over the bend of about 1 rad [-].
_LEAST = (0.5, 0.2)
# Largest bends at base and tip, over the bend of about 1 rad [-]. A slender tip saturates, so that
# large bends are drawn. The best plans for poses and fetches of a slender arm are within the
# bounds.
_MOST = (60.0, 4.0)
# Steps from an optimum of least squares to the guesses beside it, over the range of tensions.
# Smaller steps lead back to the optimum [-].
_ASIDE = 0.3
# Relative singular value below which the shape does not change [-].
_UNSEEN = 1e-6


def initial_guesses(
    problem: PlanningProblem, loaded: bool = False, missed: bool = False
) -> Iterator[Array]:
    """Yield tensions (n_tendons,) [N] within limits: fitted, drawn, and of the straight arm.

    For an arm with base joints, the guesses have joint values, too; see Placement.guesses.

    Fits are sorted by effort and distance, or by distance alone if targets are `missed`. Draws are
    sorted as in `drawn_arms`. For an arm that is `loaded`, some draws are repeated with more pull.
    """
    if problem.placement is not None:
        yield from problem.placement.guesses(problem, missed)
        return
    limits, count = problem.allowed, problem.target_set.conditions
    # Small tensions in all tendons, inside of the limits.
    straight = np.clip(5e-3 * tension_scales(problem.arm, limits), limits.lower, limits.upper)
    if count > POINT:
        yield from fitted(problem, 0.0 if missed else _EFFORT)
    # A bend in a plane has solutions with further turns. The straight arm leads to the cheapest.
    if count < POINT:
        yield straight
    for k, T in enumerate(drawn_arms(problem)):
        yield T
        if k == _FIRST and count >= POINT:
            yield straight
        if k >= _FIRST and loaded:
            yield np.clip(_STRONGER * T, limits.lower, limits.upper)


def beside(near: NlpSolution) -> Iterator[Array]:
    """Yield tensions (n_tendons,) [N] beside an optimum of a program with equalities.

    Base joints keep the values of the optimum.

    The steps are right singular vectors of the derivative of the equalities by the tensions, sorted
    by increasing singular value. Directions that do not change the equalities are omitted.
    """
    instance = near.instance
    arm, limits, n = instance.arm, instance.limits, instance.arm.n_tendons
    span = NATURAL_RANGE * natural_tensions(arm)
    J = near.derivatives[2].tocsc()
    program = instance.program
    m, equalities, first = program.n_design_rows, program.equality_rows, program.states.start
    by_tensions = -factorised(J[m:, first:]).solve(J[m:, :n].toarray())
    target_rows = J.tocsr()[equalities].tocsc()
    seen = target_rows[:, :n].toarray() + target_rows[:, first:] @ by_tensions
    _, values, directions = np.linalg.svd(seen * span / instance.unit, full_matrices=False)
    for value, direction in zip(values[::-1], directions[::-1], strict=True):
        if value > _UNSEEN * values[0]:
            for step in (_ASIDE, -_ASIDE):
                T = near.tensions + step * span * direction
                joints = near.controls[n:]
                yield np.append(np.clip(T, limits.lower, limits.upper), joints)


def drawn_arms(problem: PlanningProblem) -> Iterator[Array]:
    """Yield distinct draws, sorted by distance plus effort and by distance alone, in turn.

    Draws take little time, so that the time limit is not checked.
    """
    targets = problem.target_set
    unit = tension_scales(problem.arm, problem.allowed)
    drawn, poses, stretch = _drawn(
        problem.arm,
        problem.unloaded_scene,
        problem.allowed,
        targets.tendons,
        targets.stations,
        problem.machine_code,
    )
    distance = np.linalg.norm(_residuals(targets, poses, stretch), axis=1)
    # 0.2 is the weight of a unit of tension beside the distance.
    cheap = distance + 0.2 * np.linalg.norm(drawn / unit, axis=1)
    orders = np.argsort([cheap, distance], axis=1, kind="stable")
    yield from distinct(drawn[np.ravel(orders, "F")], unit, FAR_APART)


@lru_cache(maxsize=8)
def _drawn(
    arm: Arm,
    scene: Scene,
    limits: TendonLimits,
    tendons: frozenset[int],
    stations: tuple[float, ...],
    machine_code: bool,
) -> tuple[Array, Array, Array]:
    """Return drawn tensions (m, n_tendons), and poses (m, K, 7) and least stretches (m,) there.

    The draws depend on the targets through tendons and stations alone, so that plans for other
    targets share the poses.
    """
    bends = BendCoordinates(arm, tendons, limits)
    tensions = bends.tensions(bends.draw(_DRAWN))
    forward = ClosedForm(arm, scene, MAGNUS4, 1, stations, machine_code)
    poses, stretch = forward.many(tensions, [forward.mesh.node(s) for s in stations])
    for values in (tensions, poses, stretch):
        values.setflags(write=False)
    return tensions, poses, stretch


def fitted(problem: PlanningProblem, effort: float) -> Iterator[Array]:
    """Yield tensions (n_tendons,) fitted to targets and to little effort, the best fits first.

    `effort` is the weight of the effort beside residuals. With extension, the squeeze of each
    section (the common tension of its tendons) is fitted as well as the bends.
    """
    bends = BendCoordinates(problem.arm, problem.target_set.tendons, problem.allowed)
    unit, residuals = tension_scales(problem.arm, problem.allowed).max(), residuals_of(problem)
    # For soft residuals, a near miss with less effort is no better guess.
    weight = 0.0 if problem.target_set.terms.names[1] else effort

    def gaps(points: Array) -> Array:
        T = bends.tensions(points)
        return np.hstack([residuals(T), weight * T / unit])

    points = bends.draw(_TO_FIT)
    off = np.linalg.norm(residuals(bends.tensions(points)), axis=1)
    points = points[np.argsort(off, kind="stable")[:_FITTED]]
    if problem.scene.has(Extension):
        points = np.hstack([points, np.full((len(points), bends.width // 2), _SQUEEZED)])
    points, r = least_squares(gaps, points)
    best = np.argsort(np.linalg.norm(r, axis=1), kind="stable")[: _FITTED // 3]
    points[best], r[best] = least_squares(gaps, points[best])
    T = bends.tensions(points[np.argsort(np.linalg.norm(r, axis=1), kind="stable")])
    yield from distinct(T, np.ones(T.shape[1]), _APART, np.inf)


def distinct(
    tensions: Iterable[Array], unit: Array, part: float, norm: float = 2
) -> Iterator[Array]:
    """Yield the tensions that differ from all previous ones by more than a part of the norm."""
    taken = np.zeros((0, unit.size))
    for T in tensions:
        apart = np.linalg.norm((taken - T) / unit, norm, axis=1)
        if np.all(apart > part * np.linalg.norm(T / unit, norm)):
            taken = np.vstack([taken, T])
            yield T


def least_squares(gaps: Callable[[Array], Array], U: Array) -> tuple[Array, Array]:
    """Return points (m, n) of least squares of gaps near U, and the gaps (m, k).

    `gaps` is a function of points (m, n) -> (m, k). All points that still improve take the steps of
    the Levenberg-Marquardt method together. One call evaluates gaps and derivatives of a point.
    """
    U = U.copy()
    damping = np.full(len(U), 1e-2)
    left = np.arange(len(U))
    r, J = _linearised(gaps, U)
    for _ in range(_STEPS):
        check_time()
        if not left.size:
            break
        normal = J[left] @ J[left].transpose(0, 2, 1)
        # Damping below the rounding error would not make the system regular.
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
    """Return gaps (m, k) and derivatives (m, n, k) by U (m, n), as scaled differences."""
    (m, n), difference = U.shape, 1e-4
    shifts = np.vstack([np.zeros(n), difference * np.eye(n)])
    shifted = U[:, None, :] + shifts * (1 + np.abs(U))[:, None, :]
    values = gaps(shifted.reshape(-1, n)).reshape(m, n + 1, -1)
    return values[:, 0].copy(), (values[:, 1:] - values[:, :1]) / difference


def residuals_of(problem: PlanningProblem) -> Callable[..., Array]:
    """Return the function of tensions (m, n_tendons) [N] -> residuals (m, k), without loads.

    The residuals of the targets, the violations of inequalities, and last the collapse of the body.
    Compliances have the wanted values, so that targets of stiffness have no residual. The optional
    argument `moved` is a function of poses (m, K, 7) that moves the base.
    """
    targets = problem.target_set
    at = targets.stations
    forward = ClosedForm(problem.arm, problem.unloaded_scene, MAGNUS4, 1, at, problem.machine_code)
    nodes = [forward.mesh.node(s) for s in at]

    def residuals(tensions: Array, moved: Callable[[Array], Array] | None = None) -> Array:
        poses, stretch = forward.many(tensions, nodes)
        return _residuals(targets, poses if moved is None else moved(poses), stretch)

    return residuals


def _residuals(targets: TargetSet, poses: Array, stretch: Array) -> Array:
    """Return the residuals (m, k) of poses (m, K, 7) and least stretches (m,)."""
    m = len(poses)
    numbers = np.tile(targets.numbers, (m, 1))
    (gaps,) = residual_function(targets.terms)(poses.reshape(m, -1), numbers)
    gaps = np.hstack([gaps, 10 * np.maximum(0.05 - stretch, 0.0)[:, None]])
    return np.where(np.isfinite(gaps), gaps, np.nan)


def many_places(problem: PlanningProblem, tensions: Array) -> tuple[Array, Array]:
    """Return positions (m, K, 3) under tensions (m, n_tendons) without loads, and arc lengths (K,).

    The positions are those of the nodes beyond the base.
    """
    forward = ClosedForm(problem.arm, problem.unloaded_scene, MAGNUS4, 4, (), problem.machine_code)
    poses, _ = forward.many(tensions, range(1, forward.mesh.elements + 1))
    return poses[..., 4:], forward.mesh.s[1:]


def within_total(tensions: Array, limits: TendonLimits) -> Array:
    """Return tensions (m, n_tendons), scaled down to the limit of the total pull if there is one.

    All distances to the lower limits have the same factor.
    """
    if limits.total is None:
        return tensions
    low = np.array(limits.lower)
    most = max(limits.total - float(low.sum()), 0.0)
    above = tensions - low
    share = most / above.sum(axis=1).clip(max(most, 1e-300))
    return np.asarray(low + above * share[:, None])


class BendCoordinates:
    """The tensions of the sections as a function of bends and squeezes.

    Attributes
    ----------
    width : int
        Number of bends: two of each section with tendons that may pull.
    """

    def __init__(self, arm: Arm, tendons: frozenset[int], limits: TendonLimits) -> None:
        self._limits = limits
        phi, unit = np.array([angle for _, angle in arm.tendons]), natural_tensions(arm)
        section, pulls = np.array([i for i, _ in arm.tendons]), np.array(sorted(tendons))
        sections = np.unique(section[pulls])
        self.width = 2 * sections.size
        of_section = np.isin(np.arange(arm.n_tendons), pulls) & (section == sections[:, None])
        # Tensions (2 n, 2, n_tendons) that bend each section by about 1 rad along an axis, in both
        # directions. The tendons on the side of the bend share the load by the law of section 6.1.
        axes = np.array([[0.0, np.pi], [np.pi / 2, -np.pi / 2]])
        sides = np.exp(1j * (phi - axes[:, :, None]))
        shares = of_section[:, None, None] * np.maximum(sides.real, 0.0)
        reach = np.abs((shares * sides).sum(axis=-1, keepdims=True))
        self._sides = (shares * unit / np.where(reach > 0, reach, 1.0)).reshape(-1, 2, phi.size)
        # Tensions (n, n_tendons) of all tendons of a section.
        self._squeezes = of_section * unit

    def tensions(self, bends: Array) -> Array:
        """Return tensions (m, n_tendons) within the limits.

        `bends` are the bends (m, 2 n), or bends and roots of squeezes (m, 3 n).
        """
        bends, squeezes = bends[:, : self.width], bends[:, self.width :]
        T = np.maximum(bends, 0) @ self._sides[:, 0] + np.maximum(-bends, 0) @ self._sides[:, 1]
        if squeezes.size:
            T += squeezes**2 @ self._squeezes
        T = np.clip(T, self._limits.lower, self._limits.upper)
        return within_total(T, self._limits)

    def draw(self, count: int) -> Array:
        """Return bends (count, 2 n) in all directions, with logarithmic sizes and a fixed seed.

        In each draw a few sections bend; the other sections are straight.
        """
        rng, n = np.random.default_rng(0), self.width // 2
        low, high = np.geomspace(*_LEAST, n), np.geomspace(*_MOST, n)
        size = low * (high / low) ** rng.uniform(size=(count, n))
        angle = rng.uniform(0, 2 * np.pi, size=(count, n))
        size[rng.uniform(size=(count, n)).argsort(axis=1) >= _TOGETHER] = 0.0
        bends = np.stack([size * np.cos(angle), size * np.sin(angle)], axis=2)
        return np.asarray(bends.reshape(count, -1))
