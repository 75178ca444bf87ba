"""What a search for tensions ends with: the optimum, how it was stated, the starts tried."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from model.paths import Array
from model.quantities import Count
from planner.program.statement import Statement


@dataclass(frozen=True)
class Trial:
    """One initial guess and what became of it: the objective reached, and whether it was met."""

    objective: float
    met: bool
    iterations: Count


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What a search ends with: how the question was stated, tensions, multipliers, starts.

    `stopped` says that the time limit ended it, `jump` by how much the tensions differ from those
    of the optimum that was to be followed, over their norm, where its branch was left, `lost` by
    what share of the effort the coarse mesh had a cheaper optimum that no fine mesh has;
    `in_the_way` is the obstacle that a plan without obstacles comes nearest to, where only
    obstacles keep the targets from being met; `unstable` says that only shapes less stable than
    asked meet them; `load_path` are tensions on that of an arm in contact.
    """

    statement: Statement
    tensions: Array
    lam_x: tuple[float, ...]
    lam_g: tuple[float, ...]
    starts: tuple[Trial, ...]
    stopped: bool = False
    jump: float = 0.0
    lost: float = 0.0
    in_the_way: str = ""
    unstable: bool = False
    load_path: tuple[tuple[float, ...], ...] = ()


def agreed(starts: Sequence[Trial]) -> int:
    """Return how many starts ended at the best objective, to a thousandth."""
    best = min((start.objective for start in starts if start.met), default=float("inf"))
    near = best + 1e-3 * abs(best) + 1e-12
    return sum(start.met and start.objective <= near for start in starts)
