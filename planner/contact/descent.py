"""Steps of sequential quadratic programming in the tensions, over shapes that settle by themselves.

Each step solves a quadratic program in which what cannot be met costs in proportion; steps stay
within a region that grows and shrinks as the penalised objective falls by what was predicted, and
are corrected by how much linear terms were off where it falls by less. A step stays in its piece of
contact as far as linear terms tell, see planner.contact.pieces. Source: Nocedal and Wright,
"Numerical Optimization" (2006), 15.4 to 18.5.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.paths import Array
from model.progress import tell
from model.time_limit import is_out_of_time
from planner.contact.hessian import exact_hessian, of_targets, updated
from planner.contact.program import PENALTY, Optimum, Program, lacking
from planner.contact.quadratic import Multipliers, optimum_at, quadratic_step
from planner.contact.settled_terms import SettledTerms

STEPS, _FIRST, _MOST_FAR, _CAREFUL = 80, 0.5, 8.0, 1e-2
# The least region, and where targets are missed.
_LEAST, _MISSED = 1e-9, 1e-5
_ACCEPTED, _GOOD = 0.05, 0.7
# The most of the penalty, which would grow without end where targets are always missed.
_MOST = 1e5
# What counts as all of it.
_ALL = 0.99
# From this step on, and while targets lack less than this, each so many steps the Hessian is found
# by differences; at once where the residual is as small as this.
_ROUGH, _AGAIN, _CLOSE, _NEARLY = 4, 3, 1e-4, 1e-3
# So many steps that make up for less than this share of what targets lack lead nowhere, as where
# the arm has let go of what it is to hold.
_STUCK, _LITTLE = 3, 1e-3
# So many steps inside of their region after which so many times their gain would still leave it
# dearer than what is known.
_DEAR, _HOPED, _INSIDE = 2, 3.0, 0.99
# A gain that may be rounding: of such steps the first-order residual tells, which has to fall so.
_ROUNDING, _CLOSER = 1e-7, 0.8


def descended(
    program: Program,
    start: SettledTerms,
    accuracy: float,
    residual: float,
    known: float = np.inf,
    most: int = STEPS,
) -> Optimum:
    """Return the optimum that at most so many steps lead to, in the pieces that they meet."""
    here, region, penalty, steps = start, _FIRST, PENALTY, [start.tensions]
    B, stuck, dear = program.effort_hessian(here), 0, 0
    for count in range(most):
        if is_out_of_time():
            break
        tell("steps of the program with contact", count, most)
        best = optimum_at(program, here)
        if best.kkt < residual and lacking(here) < accuracy:
            break
        if best.kkt >= residual and _wants_hessian(best, count):
            exact = exact_hessian(program, here, best)
            B = B if exact is None else exact
        # Far from the targets steps go wherever contact lets the arm go.
        free = best.lacks > _CLOSE and region > _CAREFUL
        stated = of_targets(here) if free else here
        step, lam = quadratic_step(program, stated, B, penalty, region)
        less = best.lacks - program.predicted_violation(stated, step)
        stuck = stuck + 1 if best.lacks > _CLOSE and less < _LITTLE * best.lacks else 0
        if stuck == _STUCK:
            break
        penalty, lam = _weighed(program, best, lam, penalty, less)
        size = min(1.0, 2 * program.objective(here))
        gain = program.merit(here, penalty) - program.predicted(stated, step, penalty)
        inside = best.lacks < _CLOSE and np.abs(step).max() < _INSIDE * region
        dear = dear + 1 if inside and program.objective(here) - _HOPED * gain > known else 0
        if dear == _DEAR:
            break
        there = _stepped(program, here, step, B, penalty, region, gain)
        fell = _fall(program, here, there, penalty)
        if (
            there is not None
            and gain < _ROUNDING * size
            and _closer(program, there, best, accuracy)
        ):
            B, here = updated(program, B, here, there, lam), there
            steps.append(here.tensions)
        elif there is None or fell < _ACCEPTED * gain or gain <= 0:
            region = 0.3 * min(region, float(np.abs(step).max()))
        else:
            if fell > _GOOD * gain:
                region = min(2 * region, _MOST_FAR)
            B, here = updated(program, B, here, there, lam), there
            steps.append(here.tensions)
        if region < (_LEAST if lacking(here) < _CLOSE else _MISSED):
            break
    return replace(optimum_at(program, here), steps=tuple(steps))


def _weighed(
    program: Program, at: Optimum, lam: Multipliers, penalty: float, less: float
) -> tuple[float, Multipliers]:
    """Return the penalty of a step that leaves so much `less` lacking, and its multipliers."""
    largest = _largest(lam)
    if largest > _ALL * penalty and less > _ALL * at.lacks and at.lacks < _CLOSE:
        # Nothing will lack: the rows depend on each other, and share a multiplier at will.
        lam = at.lam_bounds, at.lam_equality, at.lam_inequality
        largest = _largest(lam)
    # What it took far from the targets would keep steps along them short, as would what is much
    # more than the effort that they cost.
    size = min(1.0, 2 * program.objective(at.terms))
    least = PENALTY * size if at.lacks < _CLOSE else penalty
    return max(least, min(2 * largest, _MOST)), lam


def _largest(lam: Multipliers) -> float:
    return max(float(np.abs(own).max(initial=0.0)) for own in lam[1:])


def _closer(program: Program, there: SettledTerms, best: Optimum, accuracy: float) -> bool:
    """Return whether a step leaves less of the first-order conditions, and targets met."""
    return lacking(there) < accuracy and optimum_at(program, there).kkt < _CLOSER * best.kkt


def _wants_hessian(at: Optimum, count: int) -> bool:
    """Return whether the Hessian is found by differences."""
    if at.lacks > _CLOSE:
        return False
    return (count == 0 and at.kkt < _NEARLY) or (count >= _ROUGH and count % _AGAIN == 0)


def _stepped(
    program: Program,
    here: SettledTerms,
    step: Array,
    B: Array,
    penalty: float,
    region: float,
    gain: float,
) -> SettledTerms | None:
    """Return the terms after a step, corrected where that is better; None if there are none."""
    there = program.moved(here, step)
    fell = _fall(program, here, there, penalty)
    same = there is not None and all(
        there.values[kind].size == own.size for kind, own in here.values.items()
    )
    if there is None or not same or fell >= _GOOD * gain:
        return there
    off = {
        kind: there.values[kind] - program.rows(here, kind) @ step
        for kind in ("equality", "inequality")
    }
    bent = replace(here, values=here.values | off)
    again = program.moved(here, quadratic_step(program, bent, B, penalty, region)[0])
    return again if _fall(program, here, again, penalty) > fell else there


def _fall(
    program: Program, here: SettledTerms, there: SettledTerms | None, penalty: float
) -> float:
    """Return by how much the penalised objective falls; without limit downwards for None."""
    if there is None:
        return -np.inf
    return program.merit(here, penalty) - program.merit(there, penalty)
