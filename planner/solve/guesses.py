"""Which first guesses a search tries, and in which order."""

from __future__ import annotations

from dataclasses import dataclass

from model.paths import Array
from planner.solve.fits import COUNT, COUNT_OF_POINT, fits
from planner.solve.starts import candidates, spread
from planner.solve.task import Task

# Where none meets what is wanted, so many of the nearest fits come first.
_OTHERS = 2


@dataclass(frozen=True, eq=False)
class Guesses:
    """First guesses, tensions (n_tendons,) that differ, in the order in which they are tried.

    Attributes
    ----------
    sure : int
        Among how many of the first the best optimum is; 0 where that is not known.
    """

    starts: list[Array]
    sure: int = 0


def first_guesses(task: Task, most: int) -> Guesses:
    """Return fits, then arms that curl more and more, then what else fits.

    Loads are left out. Where a single section may pull there is one way to curl, and no fit. For a
    point the nearest fit does: it finds what the curled arms miss 1 time in 50.
    """
    problem = task.problem(task.coarse("exact"))
    curled = [T for _, T in candidates(problem, task.targets, task.allowed)]
    if task.is_point:
        if len(curled) == 1:
            return Guesses(curled)
        found = fits(problem, task.targets, task.allowed, COUNT_OF_POINT)
        return Guesses(spread([*[*found.likely, *found.others][:1], *curled], most))
    found = fits(problem, task.targets, task.allowed, COUNT)
    first = found.likely or found.others[:_OTHERS]
    starts = spread([*first, *curled, *found.others], most)
    return Guesses(starts, 0 if problem.looks else min(len(found.likely), most))
