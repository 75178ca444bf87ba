"""Optima held to stand better, where steps in the tensions lead to an edge at which the arm snaps.

As where it is about to yield, or where a place lets go without which it does not stand. There what
tensions cost has no least value that an arm has.
"""

from __future__ import annotations

from dataclasses import replace

from model.errors import OctoplanError
from planner.contact.optima import LocalOptimum
from planner.contact.program import Program
from planner.contact.settled_terms import SettledTerms
from planner.contact.sqp import solve
from planner.contact.stated import passing

# What the term of stability may lack, over what is asked for.
_LITTLE = 0.5
# What leads to another optimum takes more steps than these.
_STEPS = 20


def steadied(
    program: Program, at: LocalOptimum, accuracy: float, residual: float
) -> LocalOptimum | None:
    """Return the optimum of a program that asks for stability, from what led to one at an edge."""
    try:
        end = solve(program, _steady(program, at), accuracy, residual, most=_STEPS)
    except OctoplanError:
        return None
    return replace(at, optimum=end) if end.lacks < accuracy else None


def _steady(program: Program, at: LocalOptimum) -> SettledTerms:
    """Return the optimum, or the last of the steps to it at which the arm stands well enough.

    The optimum as well where it lacks little of that: not next to where the arm snaps.
    """
    terms = at.optimum.terms
    here = program.evaluate(terms.tensions, terms, terms.tangential)
    if _stability(here) >= -_LITTLE * program.least:
        return here
    steps = [tuple(T.tolist()) for T in at.optimum.steps[1:]]
    way = list(passing(program, (*at.load_path, *steps)))
    return next((there for there in reversed(way) if _stability(there) >= 0), way[0])


def _stability(here: SettledTerms) -> float:
    """Return how much more stability there is than is asked for, as planner.contact.standing."""
    return float(here.values["inequality"][here.inequalities - 1])
