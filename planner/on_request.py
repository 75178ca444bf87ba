"""What a certificate tells besides its verdict, found when it is asked for.

What an arm can meet that nobody asked about, and how many times its loads it bears, take as long as
the verdict itself; a plan that is followed by the next one is seldom asked for them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property

from model.clearance import Clearance

Clearances = Mapping[str, Clearance]


class OnRequest:
    """Clearances by name, and the load factor at which an arm yields; each is found once.

    Two are equal if what they tell is. They pickle as what they tell.
    """

    def __init__(
        self,
        clearances: Callable[[], Clearances] = dict,
        load_factor: Callable[[], float | None] = lambda: None,
    ) -> None:
        self._find_clearances, self._find_load_factor = clearances, load_factor

    @cached_property
    def clearances(self) -> Clearances:
        """How clear the arm is of what it can meet, by name; see model.clearance."""
        return self._find_clearances()

    @cached_property
    def load_factor(self) -> float | None:
        """Times its loads at which it yields; see Certificate."""
        return self._find_load_factor()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, OnRequest):
            return NotImplemented
        mine, theirs = ((own.clearances, own.load_factor) for own in (self, other))
        return mine == theirs

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Callable[..., OnRequest], tuple[Clearances, float | None]]:
        return _found, (self.clearances, self.load_factor)


def _found(clearances: Clearances, load_factor: float | None) -> OnRequest:
    return OnRequest(lambda: clearances, lambda: load_factor)
