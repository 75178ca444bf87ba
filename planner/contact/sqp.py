"""Sequential quadratic programming in the tensions, over shapes that settle by themselves.

The shape is smooth in pieces, see planner.contact.pieces: steps go down as far as they lead, see
planner.contact.descent, and from an optimum at the end of a piece that beyond is tried.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.time_limit import OutOfTime
from planner.contact.descent import STEPS, descended
from planner.contact.program import PENALTY, Optimum, Program, lacking
from planner.contact.quadratic import ACTIVE, quadratic_step
from planner.contact.settled_terms import SettledTerms

# Residual of an optimum.
OPTIMAL = 3e-7
# Ends of pieces beyond which is looked, how often, and how far; what that has to gain.
_SIDES, _PROBES, _ACROSS, _GAINED, _PROBED = 2, 4, 1e-2, 1e-7, 20
# Objectives that differ by less are taken for those of one optimum.
_KNOWN = 2e-3


def solve(
    program: Program,
    start: SettledTerms,
    accuracy: float,
    residual: float = OPTIMAL,
    known: float = np.inf,
    most: int = STEPS,
) -> Optimum:
    """Return the optimum that at most so many steps lead to, beyond the pieces of contact as well.

    With a residual of the first-order conditions below the one given; where they had got to once
    the time limit is reached, or will not come below an objective that is `known`. Beyond the
    pieces is looked only from what is better than that.
    """
    best = descended(program, start, accuracy, residual, known, most)
    for _ in range(_PROBES if program.objective(best.terms) < known * (1 - _KNOWN) else 0):
        try:
            ahead = _beyond(program, best)
        except OutOfTime:
            break
        found = [descended(program, there, accuracy, residual, known, _PROBED) for there in ahead]
        found = [replace(own, steps=best.steps + own.steps) for own in found]
        better = [own for own in found if _better(program, own, best, accuracy)]
        if not better:
            break
        last, best = best, min(better, key=lambda own: program.merit(own.terms, PENALTY))
        if max(last.lacks, best.lacks) < accuracy and not _is_less(program, best, last):
            break
    return best


def _better(program: Program, one: Optimum, other: Optimum, accuracy: float) -> bool:
    """Return whether an optimum is better than another, by more than its accuracy."""
    if max(one.lacks, other.lacks) > accuracy:
        return one.lacks < 0.99 * other.lacks
    closer = one.kkt < OPTIMAL <= other.kkt
    return _is_less(program, one, other) or (closer and not _is_less(program, other, one))


def _is_less(program: Program, one: Optimum, other: Optimum) -> bool:
    a, b = (program.objective(own.terms) for own in (one, other))
    return a < b * (1 - _GAINED)


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
        there = program.moved(here, quadratic_step(program, free, B, PENALTY, _ACROSS)[0])
        # Where much is lacking all of a sudden the arm has jumped, to no piece next to this one.
        if there is not None and lacking(there) < _ACROSS + at.lacks:
            found.append(there)
    return found
