"""Which initial guesses a search tries, and in which order."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from model.paths import Array
from model.unloaded.closed_form import unloaded
from planner.initial_guess.curled import curled_arms, distinct
from planner.initial_guess.fitting import COUNT, COUNT_OF_POINT, fitted_guesses
from planner.program.statement import Mode
from planner.solve.ipopt import Solution
from planner.solve.multistart import Multistart
from planner.solve.task import Task

# Where none meets what is wanted, so many of the nearest fits come first.
_OTHERS = 4
# An optimum without loads that costs so much more than the best may be the best with them.
_DEARER = 1.2
_STRONGER, _BEFORE_STRONGER = (3.0, 8.0), 2


@dataclass(frozen=True, eq=False)
class Guesses:
    """First guesses, tensions (n_tendons,) that differ, in the order in which they are tried.

    Attributes
    ----------
    n_likely : int
        Among how many of the first the best optimum is; 0 where that is not known.
    carried : list of ((n_tendons,), Solution)
        Those that are optima of a simpler scene, best first, without their states.
    """

    starts: list[Array]
    n_likely: int = 0
    carried: list[tuple[Array, Solution]] = field(default_factory=list)


def first_guesses(task: Task) -> Guesses:
    """Return no more initial guesses than the task allows."""
    simple = task.simple
    if task.scene == simple.scene:
        return _of_closed_form(task)
    return _carried(task, simple)


def further_guesses(task: Task) -> Guesses:
    """Return initial guesses by the scene's own cross-sections, where the paper's led nowhere."""
    own = unloaded(task.scene)
    if own == task.simple.scene:
        return Guesses([])
    shape = (
        tuple(target for target in task.targets if target.compliance_request() is None)
        or task.targets
    )
    return _of_closed_form(replace(task, scene=own, targets=shape))


def _of_closed_form(task: Task) -> Guesses:
    """Return fits, then arms that curl more and more, then what else fits.

    Where a single section may pull there is one way to curl, and no fit. For a point the nearest
    fit does: it finds what the curled arms miss 1 time in 50.
    """
    problem = task.problem(task.coarse("exact"))
    curled = [T for _, T in curled_arms(problem, task.targets, task.allowed)]
    if task.is_point:
        if len(curled) == 1:
            return Guesses(curled)
        many = task.starts is not None and task.starts > len(curled)
        count = COUNT if many else COUNT_OF_POINT
        found = fitted_guesses(problem, task.targets, task.allowed, count)
        fitted = [*found.likely, *found.others]
        return Guesses(distinct([*fitted[:1], *curled, *fitted[1:] * many], task.most))
    found = fitted_guesses(problem, task.targets, task.allowed, COUNT)
    first = found.likely or found.others[:_OTHERS]
    starts = distinct([*first, *curled, *found.others], task.most)
    return Guesses(starts, 0 if problem.requests else min(len(found.likely), task.most))


def _carried(task: Task, simple: Task) -> Guesses:
    """Return the optima of a simpler scene, best first, those that cost little more as likely.

    Those for the shape alone, if there is one: how stiff it is has to be found with the loads. For
    a point, which takes few tendons, the best of them comes again with more pull: a load that is
    heavy for the tip takes several times what bends it without.
    """
    shape = (
        tuple(target for target in task.targets if target.compliance_request() is None)
        or task.targets
    )
    free = replace(simple, targets=shape)
    guesses = _of_closed_form(free)
    trials = Multistart(free, guesses.n_likely)
    mode: Mode = "exact" if free.can_be_exact else "closest"
    first = guesses.starts[: trials.first]
    found = list[Solution]()
    for T in first:
        before = [s for s in found if s.met]
        found.append(trials.solve(free.coarse(mode), T, False, before))
    for k, T in enumerate(first):
        if any(s.met for s in found):
            break
        found[k] = trials.solve(free.coarse(mode), T)
    met = sorted((s for s in found if s.finite), key=lambda s: (not s.met, s.f))
    optima = distinct([free.tensions(s) for s in met], task.most)
    likely = [s for s in met if s.met and s.f <= _DEARER * met[0].f]
    n_likely = len(distinct([free.tensions(s) for s in likely], task.most)) if likely else 0
    stronger = [more * T for T in optima[:1] for more in _STRONGER] if task.is_point else []
    few = max(n_likely, _BEFORE_STRONGER)
    starts = [*optima[:few], *stronger, *optima[few:], *guesses.starts]
    starts = distinct([np.minimum(T, task.allowed.upper) for T in starts], task.most)
    problem = free.problem(free.coarse(mode))
    known = [(free.tensions(s), s.free(problem)) for s in likely]
    return Guesses(starts, n_likely, known if shape == task.targets else [])
