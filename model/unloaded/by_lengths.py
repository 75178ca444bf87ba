"""Tensions by lengths where each cross-section settles by itself.

With exact tendons the energy is convex in the strains and so are the lengths, so that the shape of
least energy is one, and its tensions maximise a concave function: least energy over shapes plus
tensions times what tendons lack. Its gradient is what they lack, its Hessian d lengths / d tensions
comes from the cross-sections alone, and the maximum under T >= 0 is found by projected Newton
steps, each a linear complementarity problem. Source: Boyd and Vandenberghe, Convex Optimization
(2004), chapter 5. Where the law has no energy, as with the paper's tangent, the same steps solve
the same equations, without a proof that there is one solution only.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from model.arm import Arm
from model.equilibrium.complementarity import complementary, determined, unfelt
from model.errors import ConvergenceError, InputError, UnsettledSectionError
from model.mesh import Mesh
from model.paths import Array
from model.scene import Scene
from model.time_limit import check_time
from model.unloaded.tendon_lengths import Lengths, tendon_lengths
from model.winches import Winches, least_give

_STEPS, _HALVINGS = 60, 20
# What tendons may lack in the end, over the arm's length: rounding, or what does not get less; and
# what says that no shape has the lengths, with one tendon longer as well.
_ROUNDING, _MET, _SHORT, _UNKNOWN = 1e-16, 1e-12, 1e-7, 1e-5
# Tendons that lack as much as another but for this share of it, of which the first is named.
_TIED = 1e-6
# The last step, whose square is rounding: what it changes of lengths over the arm's length, and of
# tensions over the largest.
_LAST, _LAST_TENSION = 1e-7, 1e-6
# Steps may leave at most this share of the slope along them, on either side of the maximum.
_SLOPE = 0.9
# What winches give in the end, as shares of the least give: it is taken away as far as rounding of
# the lengths allows.
_FADING = (1e-2, 1e-4)
# Where no combination of tensions changes lengths by less than this share of what others do, one
# step does.
_FIRM = 1e-8
# Winches that give more and more like rigid ones, as multiples of the least give, where the least
# is not arrived at directly.
_GIVES = (1e8, 1e6, 1e4, 1e2, 1.0)


class Found(NamedTuple):
    """Tensions by lengths.

    Attributes
    ----------
    tensions : (n_tendons,)
        [N].
    left : (n_tendons,)
        What is left of held tendons beyond their paths [m], nan of others.
    first_off : float
        How far from complementary the tensions were that were begun with, over the length.
    firm : bool
        Whether no combination of tensions hardly changes lengths: rounding then decides on it.
    """

    tensions: Array
    left: Array
    first_off: float
    firm: bool


class UnloadedLengths:
    """An arm without loads on a mesh, whose tendons winches hold."""

    def __init__(
        self, arm: Arm, scene: Scene, mesh: Mesh, winches: Winches, machine_code: bool = False
    ) -> None:
        self.arm, self.winches = arm, winches
        self._lengths = tendon_lengths(arm, scene, mesh, machine_code)
        self._held, self.least = np.flatnonzero(winches.held), least_give(arm)

    def found(self, near: Array | None = None) -> Found:
        """Return tensions by lengths; the least where lengths leave them undetermined.

        Tensions `near` are begun with. Raises InputError where no shape has the lengths, and
        UnsettledSectionError, ConvergenceError.
        """
        first = self._first(near)
        found = self._maximum(first, self.least)
        if found is None:
            found = self._by_giving()
        self._check(found)
        firm = not unfelt(self._taut(found)[1], _FIRM).size
        found = self._determined(found, firm)
        left = self.winches.lacks(found.lengths, found.tensions)
        left = np.where(self.winches.held, left, np.nan)
        return Found(found.tensions, left, self._off(first, 0.0), firm)

    def _first(self, near: Array | None) -> Lengths:
        if near is None and not self.winches.tensions.any():
            return self._lengths.at_rest
        return self._lengths(self.winches.tensions if near is None else near)

    def _determined(self, found: Lengths, firm: bool) -> Lengths:
        """Return what rigid winches come to, near what winches do that give the least."""
        least, taut, M = found, *self._taut(found)
        lacks = self.winches.lacks(found.lengths, found.tensions)
        if firm:
            change = np.linalg.solve(M, -lacks[taut])
        else:
            for share in _FADING:
                nearer = self._nearer(found, share * self.least)
                if nearer is None:
                    return found
                found = nearer
            taut, M = self._taut(found)
            lacks = self.winches.lacks(found.lengths, found.tensions)
            T = found.tensions[taut]
            change = determined(M, lacks[taut], T, least.tensions[taut]) - T
        T = found.tensions.copy()
        T[taut] += change
        return found if T.min(initial=0.0) < 0 else _moved(found, T)

    def _nearer(self, at: Lengths, give: float) -> Lengths | None:
        """Return what winches come to that give for changes of the tensions only."""
        to = self._newton(at, give, at.tensions)
        return None if to is None else self._searched(at, to, give, at.tensions)

    def _taut(self, at: Lengths) -> tuple[Any, Array]:
        """Return taut tendons, and how what is left of them grows with their tensions [m/N]."""
        taut = np.flatnonzero(self.winches.held & (at.tensions > 0))
        return taut, np.diag(self.winches.stretch[taut]) - at.by_tensions[taut[:, None], taut]

    def _by_giving(self) -> Lengths:
        """Return the shape that winches come to which give less and less."""
        at, lacked = self._lengths(self.winches.tensions), np.inf
        for multiple in _GIVES:
            found = self._maximum(at, multiple * self.least)
            if found is None:
                break
            at = found
            lacks = self._lacks(at)
            if lacks > max(lacked / 2, _SHORT * self.arm.length):
                self._refuse(at)
            lacked = lacks
        if found is None:
            self._refuse(at)
            raise ConvergenceError(0.0, np.inf, "ask for lengths nearer to those at rest")
        return at

    def _maximum(self, at: Lengths, give: float) -> Lengths | None:
        """Return the shape where winches give by so much per newton; None if none is found."""
        none, last = np.zeros(self.winches.held.size), np.inf
        for _ in range(_STEPS):
            check_time()
            off = self._off(at, give)
            if off <= _ROUNDING or (off <= _MET and off > last / 2):
                return at
            to = self._newton(at, give, none)
            if to is None:
                return None
            if off <= _LAST and np.abs(to - at.tensions).max() <= _LAST_TENSION * to.max():
                return _moved(at, to)
            searched = self._searched(at, to, give, none)
            if searched is None:
                return None
            at, last = searched, off
        return None

    def _off(self, at: Lengths, give: float) -> float:
        """Return how far tensions and what is left are from complementary, over the length."""
        T = at.tensions
        own = self.winches.stretch + give - at.by_tensions.diagonal()
        off = np.abs(np.minimum(self.winches.lacks(at.lengths, T) + give * T, own * T))
        return float(off[self.winches.held].max(initial=0.0)) / self.arm.length

    def _newton(self, at: Lengths, give: float, given: Array) -> Array | None:
        """Return tensions after a Newton step where winches give for those beyond `given`."""
        held = self._held
        M, T, after = self._matrix(at, give), at.tensions[held], at.tensions.copy()
        found = complementary(M, self._left(at, give, given)[held] - M @ T, T > 0)
        if found is None:
            return None
        after[held] = found
        return after

    def _searched(self, at: Lengths, to: Array, give: float, given: Array) -> Lengths | None:
        """Return what a step to tensions, or a part of it, leads to."""
        change = to - at.tensions
        slope = abs(float(change @ self._left(at, give, given)))
        most = _SLOPE * slope + _MET * self.arm.length * np.abs(change).max()
        for halving in range(_HALVINGS):
            try:
                after = self._lengths(at.tensions + 0.5**halving * change)
            except UnsettledSectionError:
                continue
            if change @ self._left(after, give, given) <= most:
                return after
        return None

    def _left(self, at: Lengths, give: float, given: Array) -> Array:
        left = self.winches.lacks(at.lengths, at.tensions)
        return np.asarray(left + give * (at.tensions - given))

    def _matrix(self, at: Lengths, give: float) -> Array:
        """Return how what is left of held tendons grows with their tensions (n, n) [m/N]."""
        M = np.diag(self.winches.stretch + give) - at.by_tensions
        return np.asarray(M[self._held[:, None], self._held])

    def _lacks(self, at: Lengths) -> float:
        """Return what the tendon that lacks most lacks [m]."""
        lacks = self.winches.lacks(at.lengths, at.tensions)[self.winches.held]
        return float(-lacks.min(initial=0.0))

    def _check(self, found: Lengths) -> None:
        if self._lacks(found) > _SHORT * self.arm.length:
            self._refuse(found)

    def _refuse(self, found: Lengths) -> None:
        """Raise InputError that names the tendon which lacks most."""
        lacks = np.where(
            self.winches.held, -self.winches.lacks(found.lengths, found.tensions), -np.inf
        )
        j = int(np.argmax(lacks >= lacks.max() * (1 - _TIED)))
        if lacks[j] <= _SHORT * self.arm.length:
            return
        least = self._least(j, found)
        nearest = f"the nearest that a shape has is {found.lengths[j]:.9g} m"
        told = f"from {least:.7g} m on" if least else f"lengths that go together, {nearest}"
        raise InputError(
            f"lengths[{j}] ({self.arm.tendon_name(j)})",
            float(self.winches.lengths[j]),
            f"{told}, beside the other lengths: no shape of the arm has these",
        )

    def _least(self, j: int, found: Lengths) -> float:
        """Return how short a tendon is that pulls hard beside the others [m]; 0 for unknown.

        Others that want to be shorter than they can be are unknown as well. Pulling so hard that
        these give by what would count as lacking tells nothing.
        """
        held, T = self.winches.held.copy(), self.winches.tensions.copy()
        hard = _UNKNOWN / 100 * self.arm.length / self.least
        pulled = np.minimum(found.tensions, hard)
        held[j], T[j] = False, pulled[j]
        other = copy(self)
        other.winches = replace(self.winches, held=held, tensions=T)
        other._held = np.flatnonzero(held)
        at = other._maximum(self._lengths(pulled), self.least)
        if at is None or other._lacks(at) > _UNKNOWN * self.arm.length:
            return 0.0
        return float(at.lengths[j])


def _moved(at: Lengths, to: Array) -> Lengths:
    """Return the lengths under tensions so near that their second derivatives do not matter."""
    return at._replace(tensions=to, lengths=at.lengths + at.by_tensions @ (to - at.tensions))
