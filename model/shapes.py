"""The tips of many settled shapes, and what went wrong at some of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError, OctoplanError
from model.paths import Array
from model.text import MOST_LINES, columns, counted, shortened_lines

Errors = Literal["raise", "nan"]


@dataclass(frozen=True, eq=False)
class Shapes:
    """The tips of many settled shapes.

    Attributes
    ----------
    tip : (m, 3)
        [m].
    tip_frame : (m, 3, 3)
        Columns t, n, b.
    error : (m,)
        Estimated tip error over arm length [-].
    tensions : (m, n_tendons)
        [N].
    slack : (m, n_tendons)
        Whether each tendon is slack.
    problems : tuple of str
        Why each set is not settled, its numbers nan; empty of those that are.
    """

    tip: Array
    tip_frame: Array
    error: Array
    tensions: Array
    slack: NDArray[np.bool_]
    problems: tuple[str, ...] = ()

    def __repr__(self) -> str:
        lost = [f"  {i}: {why}" for i, why in enumerate(self.problems) if why]
        rows = [
            [f"  {i}", *(f"{1e3 * x:.2f}" for x in tip), f"{error:.1e}"]
            for i, (tip, error) in enumerate(zip(self.tip, self.error, strict=True))
        ]
        head = ["  tips", "x [mm]", "y [mm]", "z [mm]", "error [L]"]
        said = f"{counted(len(rows), 'set')} of tensions, {len(lost)} not settled"
        table = columns([head, *rows[:MOST_LINES]])
        more = [f"  ... and {len(rows) - MOST_LINES} more"] if len(rows) > MOST_LINES else []
        return "\n".join([said, *table, *more, *shortened_lines(lost)])


class Problems:
    """What goes wrong at sets of many: raised, or kept by the set's number."""

    def __init__(self, errors: Errors) -> None:
        if errors not in ("raise", "nan"):
            raise InputError("errors", errors, '"raise" or "nan"')
        self._raised, self._told = errors == "raise", dict[int, str]()

    @contextmanager
    def of(self, i: int) -> Iterator[None]:
        """Keep what goes wrong at a set, if it is to be kept."""
        try:
            yield
        except OctoplanError as reason:
            if self._raised:
                raise
            self._told[i] = str(reason)

    @property
    def rows(self) -> list[int]:
        """The numbers of the sets where something went wrong."""
        return list(self._told)

    def at(self, i: Any) -> Any:
        """Return whether something went wrong at each of some sets."""
        return np.isin(i, self.rows)

    def kept(self, found: Shapes) -> Shapes:
        """Return shapes with nan and the reason where something went wrong."""
        if not self._told:
            return replace(found, problems=("",) * len(found.tip))
        told = tuple(self._told.get(i, "") for i in range(len(found.tip)))
        lost = self.at(np.arange(len(told)))
        return Shapes(
            np.where(lost[:, None], np.nan, found.tip),
            np.where(lost[:, None, None], np.nan, found.tip_frame),
            np.where(lost, np.nan, found.error),
            np.where(lost[:, None], np.nan, found.tensions),
            found.slack & ~lost[:, None],
            told,
        )
