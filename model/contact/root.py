"""Where a place belongs: the root of a function of arc length that is known a value at a time.

Steps are Newton's as long as they shrink what is left; where the function bends too sharply for
that, as where an arm lies across an edge, roots are kept between values of either sign, and steps
go by the line through the last two (regula falsi with secants).
"""

from __future__ import annotations

from dataclasses import dataclass, field

# Of the way between values of either sign, how near to one of them a step may end.
_INSIDE = 0.02
# How much of the function a good step leaves, and how many steps a value is good for.
_GOOD, _STALE = 0.3, 8


@dataclass
class Root:
    """The search for one root, from value to value.

    Attributes
    ----------
    values : list of (s, f)
        In the order they came.
    """

    values: list[tuple[float, float]] = field(default_factory=list)

    def next(self, s: float, f: float, guess: float, most: float) -> float:
        """Return where to look next, after f at s; `guess` is Newton's, no farther than `most`."""
        own, guess = self.values, s + min(max(guess - s, -most), most)
        self.values = [*own[-_STALE:], (s, f)]
        if not own:
            return guess
        before, last = own[-1]
        slow = abs(f) > _GOOD * abs(last)
        if slow and f != last and before != s:
            secant = s - f * (s - before) / (f - last)
            if (secant - s) * (guess - s) > 0 or f * last < 0:
                guess = s + min(max(secant - s, -most), most)
        return self._inside(s, f, guess, slow and f * last > 0)

    def is_jump(self, s: float, f: float, near: float) -> bool:
        """Return whether the function jumps across 0 as near to s, as where an obstacle ends."""
        return any(value * f < 0 and abs(at - s) < near for at, value in self.values)

    def _inside(self, s: float, f: float, guess: float, creeps: bool) -> float:
        """Return a guess, or one between s and the nearest place where f has the other sign."""
        side = guess - s
        other = [own for own in self.values if own[1] * f < 0 and (own[0] - s) * side > 0]
        if not other:
            return guess
        wall, value = min(other, key=lambda own: abs(own[0] - s))
        if abs(side) < (1 - _INSIDE) * abs(wall - s):
            return guess
        return (s + wall) / 2 if creeps else s + f / (f - value) * (wall - s)
