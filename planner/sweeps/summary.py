"""What became of a sweep's points, counted as they pass by."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from planner.sweeps.variables import Rows

_NUMBER = re.compile(r"-?\d[\d.]*(e[+-]?\d+)?")


@dataclass
class Summary:
    """How many points there are, and what happened to them.

    Attributes
    ----------
    points : int
        All of them.
    met : int
        Those that settled, or whose targets are reached.
    kinds : dict of str to (str, int)
        Outcomes of the others: by the text without its numbers, the first of its kind and how
        many there are.
    """

    points: int = 0
    met: int = 0
    kinds: dict[str, tuple[str, int]] = field(default_factory=dict)

    def add(self, rows: Rows) -> None:
        """Count some points."""
        good = rows.values["reached" if "reached" in rows.values else "settled"]
        self.points += good.size
        self.met += int(good.sum())
        for told, is_good in zip(rows.outcomes, good.tolist(), strict=True):
            if not is_good:
                kind = _NUMBER.sub("#", told)
                example, count = self.kinds.get(kind, (told, 0))
                self.kinds[kind] = (example, count + 1)

    @property
    def failures(self) -> dict[str, int]:
        """One outcome of each kind with its number, the most frequent first."""
        return dict(sorted(self.kinds.values(), key=lambda item: -item[1]))
