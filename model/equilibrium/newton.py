"""Newton's method for equilibria by collocation, of one set of tensions or of many side by side.

Steps are bounded and have to contract. Sets are apart from each other: what is side by side are the
kernels, whose calls take longer than their operations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from octoplan.model.equilibrium.linearised import Equilibrium, History, linearised
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.support.progress import check_time

# Of an element, unless a scheme asks for fewer.
STAGES = 3
# Steps at most; those in contact may each bring places from sticking to slip or back, or other
# nodes into touch.
MAX_STEPS, MAX_STEPS_IN_CONTACT = 14, 30
# The size of the last step: larger where its factorisation is of the same point, as the next one
# would be its square.
STEP_TOL, CHORD_STEP_TOL = 1e-10, 1e-13
# A step counts as safe if it is so much smaller than the last; below SMALL rounding may be felt.
CONTRACTION, SAFE_STEP = 0.5, 1e-3
# The farthest that a frame may rotate from one equilibrium to the next on a branch [rad]; in one
# step, as a change of its quaternion. So far ahead a tangent is trusted too [rad].
MAX_BRANCH_ROTATION = 1.2
MAX_STEP_ROTATION = MAX_BRANCH_ROTATION / 2
# Guesses by another mesh are so near; the factorisation is kept after a step so small, and as long
# as steps contract so fast: a residual costs a tenth of a factorised Jacobian.
CHORD_RADIUS, CHORD_RATE = 0.02, 0.1


class Start(NamedTuple):
    """Where Newton's method begins.

    Attributes
    ----------
    tensions, load, states : (n_tendons,), float, (n_states,)
        Tensions and load factor, which stay, and the states.
    near : Equilibrium
        The equations linearised nearby, whose factorisation is begun with.
    tolerance_factor : float
        How many times larger the last steps may be; the root of that for how far from where they
        were linearised the equations count as such.
    history : History
        How the arm comes to the equilibrium.
    """

    tensions: Array
    load: float
    states: Array
    near: Equilibrium | None = None
    tolerance_factor: float = 1.0
    history: History = "loads first"


def newton(
    system: DiscreteRod,
    starts: Sequence[Start],
    farthest: float = MAX_STEP_ROTATION,
    touching: Callable[[DiscreteRod, Array], DiscreteRod] | None = None,
) -> list[Equilibrium | None]:
    """Return the equilibria near given states, each under tensions of its own.

    None where steps are not small or do not contract: that keeps to the branch of the states. In
    contact, where what touches may change in each, steps that rotate frames far are shortened.

    Parameters
    ----------
    farthest : float
        How far one step may rotate a frame.
    touching : callable
        Equations in contact and states -> the equations with what touches at these states; of one
        start.
    """
    ends, going = list[Equilibrium | None](), list[int]()
    near, unknowns, first = list[Equilibrium | None](), list[Array](), system.layout.n_before_states
    for start in starts:
        going.append(len(ends))
        ends.append(None)
        near.append(start.near and (start.near.near or start.near))
        unknowns.append(system.x(start.tensions, start.load, start.states))
    begun, before, path = near.copy(), [0.0] * len(starts), [math.inf] * len(starts)
    x = np.array(unknowns)
    nonsmooth = any(term.is_nonsmooth for term in system.terms)
    for _ in range(MAX_STEPS_IN_CONTACT if touching else MAX_STEPS):
        if not going:
            break
        check_time()
        if touching:
            last, system = system, touching(system, x[0, first:])
            near = near if np.allclose(system.p, last.p, CHORD_RADIUS, 0.0) else [None]
        some = x[going]
        points, steps = linearised(system, some, [near[i] for i in going])
        for point, row in zip(points, steps, strict=True):
            solvable = np.isfinite(row).all() and point.factor is not None
            row[:] = -point.solve(row) if solvable else np.nan
        sizes = step_sizes(system, steps, some[:, first:] + steps)
        left = list[int]()
        for i, point, step, rotation, size in zip(going, points, steps, *sizes, strict=True):
            contracts = not before[i] or size <= max(CONTRACTION * before[i], SAFE_STEP)
            is_safe = rotation <= farthest and contracts
            if math.isnan(size) or not (touching or is_safe):
                continue
            tolerance_factor, keeps = starts[i].tolerance_factor, near[i] is not None
            path[i] = size + (path[i] if keeps else 0.0)
            level = tolerance_factor * (CHORD_STEP_TOL if keeps else STEP_TOL)
            near[i] = point.near or point
            # Where it sticks and slips by turns half a step leads on.
            share = 0.5 if nonsmooth and not contracts else 1.0
            x[i, first:] += min(share, farthest / max(rotation, farthest)) * step
            if rotation <= farthest and (size < level or size**2 < level * before[i]):
                # So near to where they were linearised the equations have the same derivatives.
                is_close = path[i] < math.sqrt(STEP_TOL * tolerance_factor) and not nonsmooth
                close = near[i] if is_close else None
                ends[i] = Equilibrium(system, x[i], close, history=starts[i].history)
                continue
            far = CHORD_RADIUS if begun[i] is None else math.inf
            if nonsmooth or size > (CHORD_RATE * before[i] if before[i] else far):
                near[i] = None
            before[i] = size
            left.append(i)
        going = left
    return ends


def step_sizes(system: DiscreteRod, steps: Array, states: Array) -> tuple[list[float], list[float]]:
    """Return how far each of steps (M, n_states) rotates a frame at most (M,), as its quaternion.

    And its size (M,): the largest of this rotation, the relative change of strains (of curvatures
    relative to 1 / L at least), and the sizes that terms give their node variables.
    """
    of = system.layout
    rotation = np.abs(steps[:, of.nodes[:, :4]]).max(axis=(1, 2))
    relative = steps[:, of.stages] / (system.units + np.abs(states[:, of.stages]))
    size = np.maximum(rotation, np.abs(relative).max(axis=(1, 2)))
    for terms, groups in zip(system.node_terms, of.node_variables, strict=True):
        for term, places in zip(terms, groups, strict=True):
            own = term.step_sizes(steps[:, places], states[:, places], system.mesh)
            size = np.maximum(size, own)
    return rotation.tolist(), size.tolist()
