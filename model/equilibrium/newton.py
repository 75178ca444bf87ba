"""Newton's method for the equilibrium on a mesh, for one set of tensions or many side by side.

Steps are bounded and must contract, so that the method stays on the branch of its initial states.
The sets of tensions do not interact: they share the calls of the kernels, because a call takes
longer than the arithmetic of one set.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from octoplan.model.equilibrium.linearised import Equilibrium, History, linearised
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.support.progress import check_time

# Number of Gauss stages of an element; some callers use fewer.
STAGES = 3
# Largest number of steps.
MAX_STEPS = 14
# The same in contact: a step may change which nodes touch, and which nodes stick or slip.
MAX_STEPS_IN_CONTACT = 30
# Size of the last step if the Jacobian is evaluated at each iterate: the next step would be about
# the square of this size.
STEP_TOL = 1e-10
# Size of the last step if the factorisation of an earlier iterate is reused.
CHORD_STEP_TOL = 1e-13
# Largest ratio of a step to the last step that counts as contraction.
CONTRACTION = 0.5
# Size below which a step counts as safe without contraction, because rounding may dominate.
SAFE_STEP = 1e-3
# Largest rotation of a frame from one equilibrium to the next on a branch [rad]; a tangent is
# trusted up to the same rotation.
MAX_BRANCH_ROTATION = 1.2
# Largest change of a quaternion in one step: half the rotation of its frame.
MAX_STEP_ROTATION = MAX_BRANCH_ROTATION / 2
# Largest first step after which the factorisation is reused. Guesses from another mesh are within
# this distance. A residual costs a tenth of a factorised Jacobian.
CHORD_RADIUS = 0.02
# Largest ratio of a later step to the last step for which the factorisation is reused.
CHORD_RATE = 0.1
# Shares of a step that does not contract at a kink of the equations, such as from stick to slip.
KINK_SHARES = (1.0, 0.5, 0.25, 0.125)


class Start(NamedTuple):
    """Initial guess of Newton's method.

    Attributes
    ----------
    tensions, load : (n_tendons,), float
        Tensions [N] and load factor; constant.
    states : (n_states,)
        Initial states.
    linearised_at : Equilibrium
        Linearised equations nearby, whose factorisation is used first.
    tolerance_factor : float
        Factor of the tolerances of the last step. The distance within which linearised equations
        are shared is proportional to the square root of the factor.
    history : History
        Order of loads and tensions; copied to the equilibrium.
    """

    tensions: Array
    load: float
    states: Array
    linearised_at: Equilibrium | None = None
    tolerance_factor: float = 1.0
    history: History = "loads first"


def newton(
    system: DiscreteRod,
    starts: Sequence[Start],
    max_rotation: float = MAX_STEP_ROTATION,
    update_contacts: Callable[[DiscreteRod, Array], DiscreteRod] | None = None,
) -> list[Equilibrium | None]:
    """Return the equilibrium near each initial guess; None if the method does not converge.

    Without contact the method stops if a step is large or does not contract. In contact, steps
    with large rotations are shortened instead, because each step may change which nodes touch.

    Parameters
    ----------
    system : DiscreteRod
    starts : sequence of Start
    max_rotation : float
        Largest change of a quaternion in one step.
    update_contacts : callable
        Equations and states -> the equations with the contacts at the states; for one start.
    """
    n_before = system.layout.n_before_states
    iterations = [_Iteration.begin(system, start, max_rotation) for start in starts]
    active = iterations
    for _ in range(MAX_STEPS_IN_CONTACT if update_contacts else MAX_STEPS):
        if not active:
            break
        check_time()
        if update_contacts:
            last = system
            system = update_contacts(system, active[0].x[n_before:])
            if not np.allclose(system.p, last.p, CHORD_RADIUS, 0.0):
                active[0].linearised_at = None
        x = np.array([each.x for each in active])
        points, steps = linearised(system, x, [each.linearised_at for each in active])
        for point, row in zip(points, steps, strict=True):
            solvable = np.isfinite(row).all() and point.factor is not None
            row[:] = -point.solve(row) if solvable else np.nan
        rotations, sizes = step_sizes(system, steps, x[:, n_before:] + steps)
        remaining = list[_Iteration]()
        for each, point, step, rotation, size in zip(
            active, points, steps, rotations, sizes, strict=True
        ):
            is_safe = rotation <= max_rotation and size <= each.largest_step
            if math.isnan(size) or not (update_contacts or is_safe):
                continue
            each.take(point, step, rotation, size)
            if each.result is None:
                remaining.append(each)
        active = remaining
    return [each.result for each in iterations]


@dataclass(eq=False)
class _Iteration:
    """Iteration from one initial guess.

    Attributes
    ----------
    start : Start
    x : (n_x,)
        Tensions, load factor and states of the current iterate.
    linearised_at : Equilibrium or None
        Linearised equations whose factorisation the next step reuses; None for a new one.
    max_rotation : float
        Largest change of a quaternion in one step.
    is_nonsmooth : bool
        Whether the equations have kinks; then no factorisation is reused.
    last_size : float
        Size of the last step; 0 before the first step.
    largest_step : float
        Size up to which the next step counts as contraction.
    path : float
        Sum of the sizes of the steps since the equations were linearised.
    result : Equilibrium or None
        The equilibrium after convergence.
    """

    start: Start
    x: Array
    linearised_at: Equilibrium | None
    max_rotation: float
    is_nonsmooth: bool
    last_size: float = 0.0
    largest_step: float = math.inf
    path: float = math.inf
    result: Equilibrium | None = None

    @staticmethod
    def begin(system: DiscreteRod, start: Start, max_rotation: float) -> _Iteration:
        """Return the iteration at the initial guess."""
        x = system.x(start.tensions, start.load, start.states)
        point = start.linearised_at
        origin = point and (point.linearised_at or point)
        return _Iteration(start, x, origin, max_rotation, system.is_nonsmooth)

    def take(self, point: Equilibrium, step: Array, rotation: float, size: float) -> None:
        """Take a step; set the result after convergence, or decide on the next factorisation.

        Parameters
        ----------
        point : Equilibrium
            The equations linearised at the current iterate, or with an earlier factorisation.
        step : (n_states,)
        rotation, size : float
            See step_sizes.
        """
        reuses_factor = self.linearised_at is not None
        self.path = size + (self.path if reuses_factor else 0.0)
        tolerance = CHORD_STEP_TOL if reuses_factor else STEP_TOL
        tolerance *= self.start.tolerance_factor
        self.linearised_at = point.linearised_at or point
        share = 1.0
        if self.is_nonsmooth and self.last_size and size > CONTRACTION * self.last_size:
            share = self._share_at_kink(point, step)
        share = min(share, self.max_rotation / max(rotation, self.max_rotation))
        self.x[-step.size :] += share * step
        # The next step would be about size^2 / last_size. Squares of diverged steps overflow.
        is_small = size < tolerance or size < np.sqrt(tolerance * self.last_size)
        if rotation <= self.max_rotation and is_small:
            # Linearised equations are shared if the distance does not change the derivatives.
            limit = math.sqrt(STEP_TOL * self.start.tolerance_factor)
            shares = self.path < limit and not self.is_nonsmooth
            origin = self.linearised_at if shares else None
            self.result = Equilibrium(point.system, self.x, origin, history=self.start.history)
            return
        if self.last_size:
            largest = CHORD_RATE * self.last_size
        else:
            largest = CHORD_RADIUS if self.start.linearised_at is None else math.inf
        if self.is_nonsmooth or size > largest:
            self.linearised_at = None
        self.last_size = size
        self.largest_step = max(CONTRACTION * size, SAFE_STEP)

    def _share_at_kink(self, point: Equilibrium, step: Array) -> float:
        """Return the share of a step after which the next step is shortest.

        The next step is estimated with the same factorisation. Without this, steps cycle between
        the pieces of the equations. Source: the natural monotonicity test of Deuflhard, Newton
        Methods for Nonlinear Problems (2004), section 3.3.
        """
        system = point.system
        n_before = system.layout.n_before_states

        def size_after(share: float) -> float:
            x = self.x.copy()
            x[n_before:] += share * step
            residual = system.residual(x)
            if not np.isfinite(residual).all():
                return math.inf
            next_step = -point.solve(residual)[None]
            return step_sizes(system, next_step, x[None, n_before:] + next_step)[1][0]

        return min(KINK_SHARES, key=size_after)


def step_sizes(system: DiscreteRod, steps: Array, states: Array) -> tuple[list[float], list[float]]:
    """Return the largest change of a quaternion (M,) and the size (M,) of steps (M, n_states).

    The size is the largest of this change, of the relative changes of the strains (curvatures
    relative to 1 / L at least), and of the sizes that terms assign to their node variables.
    """
    layout = system.layout
    rotation = np.abs(steps[:, layout.nodes[:, :4]]).max(axis=(1, 2))
    relative = steps[:, layout.stages] / (system.units + np.abs(states[:, layout.stages]))
    size = np.maximum(rotation, np.abs(relative).max(axis=(1, 2)))
    for terms, groups in zip(system.node_terms, layout.node_variables, strict=True):
        for term, places in zip(terms, groups, strict=True):
            term_size = term.step_sizes(steps[:, places], states[:, places], system.mesh)
            size = np.maximum(size, term_size)
    return rotation.tolist(), size.tolist()
