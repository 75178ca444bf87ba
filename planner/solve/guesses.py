"""Which first guesses a search tries, and in which order."""

from __future__ import annotations

from model.paths import Array
from planner.solve.fits import fits
from planner.solve.starts import candidates, spread
from planner.solve.task import Task

# Fits that come before the curled arms; 8 in 10 times the first of them leads to the best optimum.
_FITS = 2
# For a point one does, of fewer: it finds what the curled arms miss 1 time in 50.
_FITS_OF_POINT, _SHARE = 1, 0.3


def first_guesses(task: Task, most: int) -> list[Array]:
    """Return tensions that differ: fits, then arms that curl more and more, then what else fits.

    Loads are left out. Where a single section may pull there is one way to curl, and no fit.
    """
    problem = task.problem(task.coarse("exact"))
    curled = [T for _, T in candidates(problem, task.targets, task.allowed)]
    if task.is_point and len(curled) == 1:
        return curled
    share, count = (_SHARE, _FITS_OF_POINT) if task.is_point else (1.0, _FITS)
    met, others = fits(problem, task.targets, task.allowed, share)
    first, rest = (met or others)[:count], [] if task.is_point else [*met[count:], *others]
    return spread([*first, *curled, *rest], most)
