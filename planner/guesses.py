"""Which first guesses a search tries, and in which order."""

from __future__ import annotations

from model.paths import Array
from planner.fits import fits
from planner.starts import candidates, spread
from planner.task import Task

# Fits that come before the curled arms; 9 in 10 times the first of them leads to the best optimum.
_FITS = 2


def first_guesses(task: Task, most: int) -> list[Array]:
    """Return tensions that differ: of curled arms for a point, for anything else fits before them.

    Loads are left out.
    """
    problem = task.problem(task.coarse("exact"))
    curled = [T for _, T in candidates(problem, task.targets, task.allowed)]
    if task.is_point:
        return spread(curled, most)
    met, others = fits(problem, task.targets, task.allowed)
    return spread([*(met or others)[:_FITS], *curled, *met[_FITS:], *others], most)
