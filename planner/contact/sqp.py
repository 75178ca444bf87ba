"""Sequential quadratic programming in the tensions, over shapes that settle by themselves.

Each step solves a quadratic program in which what cannot be met costs in proportion; steps stay
within a region that grows and shrinks as the penalised objective falls by what was predicted, and
are corrected by how much linear terms were off where it falls by less. The shape is smooth in
pieces, see planner.contact.pieces: a step stays in its piece as far as linear terms tell, and from
an optimum at the end of one that beyond is tried. Source: Nocedal and Wright, "Numerical
Optimization" (2006), 15.4 to 18.5.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.paths import Array
from model.progress import tell
from model.time_limit import OutOfTime, is_out_of_time
from planner.contact.hessian import exact_hessian, of_targets, updated
from planner.contact.program import Optimum, Program, lacking
from planner.contact.quadratic import ACTIVE, optimum_at, quadratic_step
from planner.contact.settled_terms import SettledTerms

_STEPS, _FIRST, _MOST_FAR, _CAREFUL = 80, 0.5, 8.0, 1e-2
# The least region, and where targets are missed.
_LEAST, _MISSED = 1e-9, 1e-5
_ACCEPTED, _GOOD = 0.05, 0.7
# Of the penalty. Where targets are always missed it would grow without end.
_PENALTY, _MOST = 10.0, 1e5
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
# Residual of an optimum.
OPTIMAL = 3e-7
# Ends of pieces beyond which is looked, how often, and how far; what that has to gain.
_SIDES, _PROBES, _ACROSS, _GAINED, _PROBED = 2, 4, 1e-2, 1e-7, 20


def solve(
    program: Program,
    start: SettledTerms,
    accuracy: float,
    residual: float = OPTIMAL,
    known: float = np.inf,
) -> Optimum:
    """Return the optimum that steps from a start lead to, beyond the pieces of contact as well.

    With a residual of the first-order conditions below the one given; where they had got to once
    the time limit is reached, or will not come below an objective that is `known`.
    """
    best = _descended(program, start, accuracy, residual, known)
    for _ in range(_PROBES if program.objective(best.terms) <= known * (1 + _GAINED) else 0):
        try:
            ahead = _beyond(program, best)
        except OutOfTime:
            break
        found = [_descended(program, there, accuracy, residual, known, _PROBED) for there in ahead]
        found = [replace(own, steps=best.steps + own.steps) for own in found]
        better = [own for own in found if _better(program, own, best, accuracy)]
        if not better:
            break
        best = min(better, key=lambda own: program.merit(own.terms, _PENALTY))
    return best


def _better(program: Program, one: Optimum, other: Optimum, accuracy: float) -> bool:
    """Return whether an optimum is better than another, by more than its accuracy."""
    if max(one.lacks, other.lacks) > accuracy:
        return one.lacks < 0.99 * other.lacks
    a, b = (program.objective(own.terms) for own in (one, other))
    closer = one.kkt < OPTIMAL <= other.kkt
    return a < b * (1 - _GAINED) or (closer and a < b * (1 + _GAINED))


def _beyond(program: Program, at: Optimum) -> list[SettledTerms]:
    """Return terms in the pieces beyond those ends of the piece that hold an optimum."""
    here, found = at.terms, list[SettledTerms]()
    lam = np.abs(at.lam_inequality[here.inequalities :])
    for k in np.argsort(-lam)[:_SIDES]:
        if lam[k] <= ACTIVE:
            continue
        keep = np.delete(np.arange(at.lam_inequality.size), here.inequalities + k)
        values = here.values | {"inequality": here.values["inequality"][keep]}
        jacobian = here.jacobian | {"inequality": here.jacobian["inequality"][keep]}
        free, B = replace(here, values=values, jacobian=jacobian), program.effort_hessian(here)
        there = program.moved(here, quadratic_step(program, free, B, _PENALTY, _ACROSS)[0])
        # Where much is lacking all of a sudden the arm has jumped, to no piece next to this one.
        if there is not None and lacking(there) < _ACROSS + at.lacks:
            found.append(there)
    return found


def _descended(
    program: Program,
    start: SettledTerms,
    accuracy: float,
    residual: float,
    known: float,
    most: int = _STEPS,
) -> Optimum:
    """Return the optimum that at most so many steps lead to, in the pieces that they meet."""
    here, region, penalty, steps = start, _FIRST, _PENALTY, [start.tensions]
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
        largest = max(float(np.abs(own).max(initial=0.0)) for own in lam[1:])
        if largest > _ALL * penalty and less > _ALL * best.lacks and best.lacks < _CLOSE:
            # Nothing will lack: the rows depend on each other, and share a multiplier at will.
            lam = best.lam_bounds, best.lam_equality, best.lam_inequality
            largest = max(float(np.abs(own).max(initial=0.0)) for own in lam[1:])
        # What it took far from the targets would keep steps along them short, as would what is
        # much more than the effort that they cost.
        size = min(1.0, 2 * program.objective(here))
        least = _PENALTY * size if best.lacks < _CLOSE else penalty
        penalty = max(least, min(2 * largest, _MOST))
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
