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
from dataclasses import dataclass, replace

import numpy as np

from model.arm import Arm
from model.cross_section import cross_section_of
from model.cross_section.sections import Sections
from model.equilibrium.complementarity import complementary, determined, unfelt
from model.errors import ConvergenceError, InputError, UnsettledSectionError
from model.mesh import Mesh
from model.paths import Array
from model.scene import Scene
from model.time_limit import check_time
from model.transcription.collocation import gauss
from model.unloaded.closed_form import unloaded
from model.unloaded.settled_sections import settled_sections
from model.winches import Winches, least_give

_STAGES, _STEPS, _HALVINGS = 3, 60, 20
# What tendons may lack in the end, over the arm's length: rounding, or what does not get less; and
# what says that no shape has the lengths, with one tendon longer as well.
_ROUNDING, _MET, _SHORT, _UNKNOWN = 1e-16, 1e-12, 1e-7, 1e-5
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


@dataclass(frozen=True, eq=False)
class Settled:
    """Cross-sections under tensions.

    Attributes
    ----------
    tensions : (n_tendons,)
    strains : (N, n)
    by_tensions : (N, n, n_tendons)
        How the strains move with them.
    lengths : (n_tendons,)
        Of the tendons.
    length_tension : (n_tendons, n_tendons)
        How these move with the tensions [m/N].
    """

    tensions: Array
    strains: Array
    by_tensions: Array
    lengths: Array
    length_tension: Array


class UnloadedLengths:
    """An arm without loads on a mesh, whose tendons winches hold."""

    def __init__(self, arm: Arm, scene: Scene, mesh: Mesh, winches: Winches) -> None:
        self.arm, self.scene, self.winches = arm, unloaded(scene), winches
        method, h = gauss(_STAGES), np.diff(mesh.s)
        s = (mesh.s[:-1, None] + h[:, None] * method.c).ravel()
        self.active, self.weights = np.repeat(mesh.active, _STAGES), np.outer(h, method.b).ravel()
        law = cross_section_of(self.scene, torsion=False)
        self.sections = Sections(arm, self.scene, law, s, self.active)
        self.least = least_give(arm)

    def found(self, near: Array | None = None) -> tuple[Array, Array]:
        """Return tensions, and what is left of held tendons beyond their paths (n_tendons,) each.

        The least tensions where lengths leave them undetermined; `near` are some to begin with.
        Raises InputError where no shape has the lengths, and UnsettledSectionError,
        ConvergenceError.
        """
        first = self.winches.tensions if near is None else near
        found = self._maximum(self._settled(first), self.least)
        if found is None:
            found = self._by_giving()
        self._check(found)
        found = self._determined(found)
        left = self.winches.lacks(found.lengths, found.tensions)
        return found.tensions, np.where(self.winches.held, left, np.nan)

    def _determined(self, found: Settled) -> Settled:
        """Return what rigid winches come to, near what winches do that give the least."""
        least = found
        for share in _FADING if unfelt(self._taut(found), _FIRM).size else ():
            nearer = self._step(found, share * self.least, found.tensions)
            if nearer is None:
                return found
            found = nearer
        taut = np.flatnonzero(self.winches.held & (found.tensions > 0))
        M = self._taut(found)
        lacks = self.winches.lacks(found.lengths, found.tensions)[taut]
        T = found.tensions.copy()
        T[taut] = determined(M, lacks, T[taut], least.tensions[taut])
        if T.min(initial=0.0) < 0:
            return found
        predicted = found.strains + found.by_tensions @ (T - found.tensions)
        return self._settled(T, predicted)

    def _taut(self, at: Settled) -> Array:
        """Return how what is left of taut tendons grows with their tensions (n, n) [m/N]."""
        taut = np.flatnonzero(self.winches.held & (at.tensions > 0))
        found = at.length_tension[np.ix_(taut, taut)]
        return np.asarray(np.diag(self.winches.stretch[taut]) - found)

    def _by_giving(self) -> Settled:
        """Return the shape that winches come to which give less and less."""
        at, lacked = self._settled(self.winches.tensions), np.inf
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

    def _maximum(self, at: Settled, give: float) -> Settled | None:
        """Return the shape where winches give by so much per newton; None if none is found."""
        held, none, last = self.winches.held, np.zeros(self.winches.held.size), np.inf
        for _ in range(_STEPS):
            check_time()
            lacks, T = self._left(at, give, none)[held], at.tensions[held]
            own = np.diag(self._matrix(at, give))
            off = np.abs(np.minimum(lacks, own * T)).max(initial=0.0) / self.arm.length
            if off <= _ROUNDING or (off <= _MET and off > last / 2):
                return at
            last = off
            step = self._step(at, give, none)
            if step is None:
                return None
            at = step
        return None

    def _step(self, at: Settled, give: float, given: Array) -> Settled | None:
        """Return what a Newton step leads to where winches give for tensions beyond those given."""
        held = self.winches.held
        T, M = at.tensions[held], self._matrix(at, give)
        lacks = self._left(at, give, given)[held]
        found = complementary(M, lacks - M @ T, T > 0)
        return None if found is None else self._searched(at, found - T, lacks, give, given)

    def _searched(
        self, at: Settled, change: Array, lacks: Array, give: float, given: Array
    ) -> Settled | None:
        """Return what a step in the held tensions, or a part of it, leads to."""
        held, slope = self.winches.held, float(change @ lacks)
        moved = np.zeros(held.size)
        moved[held] = change
        for halving in range(_HALVINGS):
            part = 0.5**halving
            try:
                predicted = at.strains + part * (at.by_tensions @ moved)
                after = self._settled(at.tensions + part * moved, predicted)
            except (UnsettledSectionError, np.linalg.LinAlgError):
                continue
            left = float(change @ self._left(after, give, given)[held])
            if left <= _SLOPE * abs(slope) + _MET * self.arm.length * np.abs(change).max():
                return after
        return None

    def _settled(self, tensions: Array, predicted: Array | None = None) -> Settled:
        """Return the cross-sections under tensions, near predicted strains if they settle there."""
        pulls, v = self.sections.pulls(tensions), predicted
        if v is not None:
            with np.errstate(all="ignore"):
                try:
                    v = self.sections.solve(v, np.zeros_like(v), pulls)
                except np.linalg.LinAlgError:
                    v = None
        if v is None or np.isnan(v).any():
            v = settled_sections(self.arm, self.scene, self.sections, self.active, tensions)
        moved = self.sections.by_tensions(v, pulls)
        lengths, slopes = self.sections.length_slopes(v, self.weights)
        n = tensions.size
        by_tensions = slopes.reshape(n, -1) @ moved.reshape(-1, n)
        return Settled(tensions, v, moved, lengths, by_tensions)

    def _left(self, at: Settled, give: float, given: Array) -> Array:
        left = self.winches.lacks(at.lengths, at.tensions)
        return np.asarray(left + give * (at.tensions - given))

    def _matrix(self, at: Settled, give: float) -> Array:
        held = self.winches.held
        own = np.diag(self.winches.stretch[held] + give)
        return np.asarray(own - at.length_tension[np.ix_(held, held)])

    def _lacks(self, at: Settled) -> float:
        """Return what the tendon that lacks most lacks [m]."""
        lacks = self.winches.lacks(at.lengths, at.tensions)[self.winches.held]
        return float(-lacks.min(initial=0.0))

    def _check(self, found: Settled) -> None:
        if self._lacks(found) > _SHORT * self.arm.length:
            self._refuse(found)

    def _refuse(self, found: Settled) -> None:
        """Raise InputError that names the tendon which lacks most."""
        lacks = np.where(
            self.winches.held, -self.winches.lacks(found.lengths, found.tensions), -np.inf
        )
        j = int(np.argmax(lacks))
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

    def _least(self, j: int, found: Settled) -> float:
        """Return how short a tendon is that pulls hard beside the others [m]; 0 for unknown.

        Others that want to be shorter than they can be are unknown as well.
        """
        held, T = self.winches.held.copy(), self.winches.tensions.copy()
        held[j], T[j] = False, found.tensions[j]
        other = copy(self)
        other.winches = replace(self.winches, held=held, tensions=T)
        at = other._maximum(other._settled(found.tensions), self.least)
        if at is None or other._lacks(at) > _UNKNOWN * self.arm.length:
            return 0.0
        return float(at.lengths[j])
