"""Equilibria on a mesh whose tendons winches hold; what `settle` refines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from model.arm import Arm
from model.contact.forward import TouchingMap
from model.equilibrium.complementarity import ROUNDING, is_firm, least
from model.equilibrium.forward import Collocation, Known
from model.equilibrium.hold import HeldLengths
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton
from model.forward import ForwardMap
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.transcription.kernel import Places
from model.unloaded.by_lengths import NEARLY, SQUARE, Found, UnloadedLengths
from model.unloaded.too_short import SHORT, unknown_least
from model.winches import Winches

# Newton steps to rounding, more where lengths hardly feel some combinations of tensions; one does
# that changes tensions by no more than this share. All are felt that change lengths by such a share
# of what others do; then rigid winches are not needed.
_TIGHTENED, _WEAK, _LAST, _FIRM = 2, 12, 1e-7, 1e-5
# After a step that changes tensions by more, the equations are linearised afresh; by less, and not
# half as much as the one before, it was rounding.
_FAR, _NOISE = 1e-4, 1e-2


class OnMesh(NamedTuple):
    """An equilibrium on a mesh.

    Attributes
    ----------
    tensions : (n_tendons,)
        [N].
    states, stretch
        See ForwardMap.run.
    left : (n_tendons,)
        What is left of held tendons beyond their paths [m], nan of others; None without any.
    here : Linearised
        The equations linearised there, where lengths are held under loads.
    snaps : tuple of float
        The shares of the way at which the arm jumped; see TouchingMap.come_to.
    before : (tensions, states) or None
        With friction of contacts, of the equilibrium before the last step.
    """

    tensions: Array
    states: Array
    stretch: Array
    left: Array | None = None
    here: Linearised | None = None
    snaps: tuple[float, ...] = ()
    before: tuple[Array, Array] | None = None


class Near(NamedTuple):
    """An equilibrium that another mesh has.

    Attributes
    ----------
    tensions : (n_tendons,)
    known : Known or None
        Its states, of a forward map that is implicit.
    """

    tensions: Array
    known: Known | None


@dataclass(frozen=True, eq=False)
class GivenTensions:
    """Tensions that motors hold."""

    tensions: Array
    winches: None = None

    def on(self, forward: ForwardMap, near: Near | None) -> OnMesh:
        """Return the equilibrium on the mesh of a forward map, near that of another if given."""
        known: Any = None if near is None else near.known
        if isinstance(forward, TouchingMap):
            before = self.tensions if near is None else near.tensions
            way = forward.led(self.tensions, before, known)
            rows = forward.rows(way.settled.held.here)
            found = OnMesh(self.tensions, *rows, snaps=way.snaps)
            if way.before is None:
                return found
            last = way.before.tensions, forward.rows(way.before)[0]
            return found._replace(before=last)
        return OnMesh(self.tensions, *forward.run(self.tensions, known))

    def finished(self, forward: ForwardMap, found: OnMesh) -> OnMesh:
        """Return an equilibrium that is accepted, to rounding: it is."""
        return found


@dataclass(frozen=True, eq=False)
class GivenLengths:
    """Lengths that winches leave, of some tendons or all.

    Attributes
    ----------
    near : (n_tendons,)
        Tensions to begin with.
    """

    arm: Arm
    scene: Scene
    winches: Winches
    machine_code: bool = False
    near: Array | None = None

    def on(self, forward: ForwardMap, near: Near | None) -> OnMesh:
        """See GivenTensions.on; raises InputError where no shape has the lengths."""
        if not (is_loaded(self.scene) and isinstance(forward, Collocation)):
            T, left = self._unloaded.tensions, self._unloaded.left
            return OnMesh(T, *forward.run(T), left)
        hold = HeldLengths(self.winches)
        here = None
        if near is not None and near.known is not None:
            T = np.where(self.winches.held, near.tensions, self.winches.tensions)
            here = forward.near(T, near.known, hold)
        if here is None:
            here = forward.from_rest(self._unloaded.tensions, hold)
        return self._of(forward, here)

    def finished(self, forward: ForwardMap, found: OnMesh) -> OnMesh:
        """Return an equilibrium that is accepted, its tensions found to rounding.

        Raises UnknownLeastError where a tendon turns out to be longer than it may be.
        """
        if found.here is None or not isinstance(forward, Collocation):
            return found
        tight = _tightened(found.here, HeldLengths(self.winches))
        left = self.winches.lacks(tight.lengths, tight.tensions)
        over = np.where(self.winches.held, -left, 0.0)
        if over.max() > SHORT * self.arm.length:
            raise unknown_least(self.arm, self.winches, int(np.argmax(over)))
        return self._of(forward, tight)

    def _of(self, forward: Collocation, here: Linearised) -> OnMesh:
        left = self.winches.lacks(here.lengths, here.tensions)
        left = np.where(self.winches.held, left, np.nan)
        return OnMesh(here.tensions, *forward.rows(here), left, here=here)

    @cached_property
    def _unloaded(self) -> Found:
        """Tensions of the arm without its loads, found once: no mesh is asked for."""
        given = self.arm, self.scene, self.winches
        near = None if is_loaded(self.scene) else self.near
        return UnloadedLengths(*given, self.machine_code).found(near)


def _tightened(here: Linearised, hold: HeldLengths) -> Linearised:
    """Return an equilibrium with its weakly determined tensions found as well, to rounding.

    By Newton steps in all unknowns; of combinations of tensions that no length feels the least are
    found.
    """
    system, winches = here.system, hold.winches
    rounding = ROUNDING * system.arm.length
    weak = not is_firm(_by_tensions(here, winches, _tight(here, winches)), _FIRM)
    if weak:
        kept = here.near or here
        here = newton(system, here.tensions, 1.0, here.states, kept=kept, hold=hold) or here
    near, last = here.near or here, 0.0
    for _ in range(_WEAK if weak else _TIGHTENED):
        at = near if near.x is here.x else Linearised(system, here.x, near)
        change, now = -at.solve(at.residual), at.tensions
        tight = _tight(at, winches)
        left = winches.lacks(at.lengths + at.length_jacobian @ change, now)[tight]
        after = now.copy()
        step = least(_by_tensions(at, winches, tight), left, now[tight], rounding)
        after[tight] = step.z
        change += at.by_tensions @ (after - now)
        here = Linearised(system, system.x(after, 1.0, at.states + change), near)
        moved, most = np.abs(after - now).max(initial=0.0), after.max(initial=0.0)
        off, noise = np.abs(left).max(initial=0.0), 0 < last / 2 < moved <= _NOISE * most
        done = moved <= _LAST * most or noise or off * moved**2 <= SQUARE * rounding * last**2
        if step.whole and done:
            break
        last = moved
        if moved > _FAR * most:
            near = here = Linearised(system, here.x)
    return (newton(system, here.tensions, 1.0, here.states, kept=near) if weak else None) or here


def _tight(here: Linearised, winches: Winches) -> Places:
    """Return the tendons that winches hold which are taut, or as long as these leave."""
    left = winches.lacks(here.lengths, here.tensions)
    near = left <= NEARLY * here.system.arm.length
    return np.flatnonzero(winches.held & ((here.tensions > 0) | near))


def _by_tensions(at: Linearised, winches: Winches, taut: Places) -> Array:
    """Return how what is left of taut tendons grows with their tensions [m/N]."""
    return np.asarray(np.diag(winches.stretch[taut]) - at.length_tension[np.ix_(taut, taut)])
