"""What is held while an arm goes to its equilibrium: the tensions, or lengths of tendons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from model.equilibrium.complementarity import complementary
from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import stand, unstable_modes
from model.paths import Array
from model.winches import Winches, arm_compliance, least_compliance

# Steps far from the lengths are damped in the combinations of tensions that hardly change these.
_DAMPED = 0.01
# Combinations of tensions that change lengths by less than this share of what others do are left:
# rounding would drive them. Those that no length feels may have to slacken a tendon: they are left
# where so little is off that the damping is no more than such a share either.
_WEAK, _UNFELT, _DRIVEN = 1e-6, 3e-9, 1e-8


class Hold(Protocol):
    """See HeldTensions and HeldLengths.

    Attributes
    ----------
    creep : float
        Steps so small, relative to strains, that do not shrink are of what is hardly determined.
    """

    @property
    def creep(self) -> float:
        """See Hold."""

    def tensions(self, here: Linearised, change: Array, now: Array) -> Array | None:
        """Return the tensions (n_tendons,) after a Newton step from here; None if there are none.

        `change` (n_states,) is the step at the tensions as they are `now`.
        """

    def by_load(self, here: Linearised) -> Array:
        """Return how tensions move with the load factor (n_tendons,)."""

    def stand(self, heres: Sequence[Linearised]) -> list[bool]:
        """Return whether equilibria of one layout are stable while this is held."""


@dataclass(frozen=True)
class HeldTensions:
    """Tensions that do not change: force-controlled motors."""

    creep: float = 0.0

    def tensions(self, here: Linearised, change: Array, now: Array) -> Array:
        """See Hold.tensions."""
        return now

    def by_load(self, here: Linearised) -> Array:
        """See Hold.by_load."""
        return np.zeros(here.system.of.n_tendons)

    def stand(self, heres: Sequence[Linearised]) -> list[bool]:
        """See Hold.stand."""
        return stand(heres)


TENSIONS = HeldTensions()


@dataclass(frozen=True, eq=False)
class HeldLengths:
    """Tendons that are no longer than what winches leave, T >= 0, one of the two with equality.

    With lengths l(T) of the equilibrium linearised at the states, a step is the solution of a
    linear complementarity problem in the tensions: Newton's method for the nonlinear one (Josephy,
    Univ. of Wisconsin MRC report 1965, 1979). Its matrix is less d l / d T: positive definite where
    the arm stands by itself.

    Attributes
    ----------
    winches : Winches
    """

    winches: Winches
    creep: float = 1e-6

    def tensions(self, here: Linearised, change: Array, now: Array) -> Array | None:
        """See Hold.tensions."""
        arm, held, T = here.system.arm, self.winches.held, now[self.winches.held]
        M, lengths = self._matrix(here), here.lengths + here.length_jacobian @ change
        if not np.isfinite(M).all():
            return None
        lacks = self.winches.lacks(lengths, now)[held]
        off = float(np.abs(np.minimum(lacks, np.diag(M) * T)).max(initial=0.0))
        soft, taut = arm_compliance(arm), np.flatnonzero(T > 0)
        damping = _DAMPED * off / (T.max(initial=0.0) + off / soft) if off else 0.0
        idle = _left_alone(M[np.ix_(taut, taut)], damping)
        M = M + damping * np.eye(T.size)
        M[np.ix_(taut, taut)] += soft * idle.T @ idle
        found = complementary(M, lacks - M @ T, T > 0)
        if found is None:
            return None
        after = now.copy()
        after[held] = found
        return after

    def by_load(self, here: Linearised) -> Array:
        """See Hold.by_load: taut tendons stay as long as they are."""
        held, moved = self.winches.held, np.zeros(here.system.of.n_tendons)
        taut = here.tensions[held] > 0
        longer = (here.length_jacobian @ here.by_load)[held][taut]
        places = np.flatnonzero(held)[taut]
        moved[places] = np.linalg.solve(self._matrix(here)[np.ix_(taut, taut)], longer)
        return moved

    def stand(self, heres: Sequence[Linearised]) -> list[bool]:
        """See Hold.stand."""
        return [self._stands(here) for here in heres]

    def _stands(self, here: Linearised) -> bool:
        """Return whether the taut tendons keep it from moving where it would not stand.

        Held lengths have to bar every direction in which it is unstable with tensions held: with H
        the Hessian of the energy and L the Jacobian of the lengths, [H, L^T; L, -stretch] has as
        many negative eigenvalues as H and stretch + L H^-1 L^T have together, its negative ones
        counted as positive (Haynsworth, Linear Algebra and its Applications 1, 1968).
        """
        unstable = unstable_modes(here)
        if not unstable:
            return True
        taut = here.tensions[self.winches.held] > 0
        own = self._matrix(here)[np.ix_(taut, taut)]
        return unstable == int((np.linalg.eigvals(own).real < 0).sum())

    def _matrix(self, here: Linearised) -> Array:
        """Return how what is left of held tendons grows with their tensions (n, n) [m/N].

        With the least compliance as well: it keeps a step definite, no part of the equations.
        """
        held = self.winches.held
        compliance = self.winches.stretch[held] + least_compliance(here.system.arm)
        return np.asarray(np.diag(compliance) - here.length_tension[np.ix_(held, held)])


def _left_alone(M: Array, damping: float) -> Array:
    """Return the combinations (k, n) of taut tendons that a step leaves as they are; see _WEAK."""
    _, values, right = np.linalg.svd(M)
    most = values.max(initial=0.0)
    still = (values > _UNFELT * most) | (values + damping <= _DRIVEN * most)
    return np.asarray(right[(values <= _WEAK * most) & still])
