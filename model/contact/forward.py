"""The forward map of a scene with contact: tensions to states on a mesh that moves with them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from model.arm import Arm
from model.contact.moving import Question, Settled, gaps_along, places_of, settled
from model.contact.newton import Held
from model.contact.path import Followed, follow, from_rest
from model.contact.places import SAME, Place
from model.contact.touches import Touches
from model.equilibrium.forward import Collocation, Known
from model.equilibrium.linearised import Linearised
from model.errors import InputError, SnapError
from model.loads import contacts, growth, places
from model.mesh import Mesh, graded
from model.obstacles import numbers_of
from model.paths import Array
from model.scene import Scene
from model.transcription.neighbours import landmarks
from model.transcription.system import System

# Elements of a mesh over those of one without contact, and how long the longest may be: a share of
# the arm's length, or of obstacle and arm together, but no shorter than a share of the length.
_FINER, _LONGEST, _SHORTEST = 2, 1 / 16, 1 / 100
# Columns behind the states of a row: arc length, then of each obstacle how the node touches it,
# gap'' there, and whether the element beyond lies on it.
_CODES = 3
_POINT, _END, _INSIDE = 1.0, 2.0, 3.0


@dataclass(frozen=True, eq=False)
class KnownContact(Known):
    """States of an equilibrium with contact on some mesh, and how its nodes touch."""

    touches: Touches


class TouchingMap(Collocation):
    """See ForwardMap; a row of its states is followed by its arc length and how it touches."""

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        stages: int,
        refinement: int,
        at: tuple[float, ...] = (),
        machine_code: bool = False,
    ) -> None:
        own = (*at, *places(arm, scene))
        base = graded(arm, _FINER * refinement, own, partial(_density, arm, scene))
        self._state(System(arm, scene, base, stages, True, machine_code))
        self._fixed, self._machine_code = np.unique(landmarks(arm, scene, at)), machine_code
        self._last: tuple[Array, Collocation] | None = None
        self._rest = self.without_loads(np.zeros(arm.n_tendons))
        self._check_outside()

    def _check_outside(self) -> None:
        """Raise InputError where the arm at rest is inside of an obstacle."""
        s, gap = gaps_along(self.system, self._rest)
        for j, contact in enumerate(contacts(self.system.scene)):
            if contact.friction:
                allowed = "0: which way it acts, a static question without history does not tell"
                raise InputError("Contact.friction", contact.friction, allowed)
            at = int(np.argmin(gap[:, j]))
            if gap[at, j] < -SAME * self.system.arm.length:
                told = f"it is {-1e3 * gap[at, j]:.3g} mm inside at s = {s[at]:.4g} m"
                allowed = f"one that the arm at rest is clear of; {told}"
                raise InputError("Contact.obstacle", contact.obstacle, allowed)

    def run(self, tensions: Array, near: Known | None = None) -> tuple[Array, Array]:
        """See ForwardMap.run; raises SnapError."""
        return self.rows(self.found(tensions, near))

    def found(self, tensions: Array, known: Known | None = None) -> Linearised:
        """Return the equilibrium under tensions, near one that another mesh has, if any does."""
        return self.come_to(tensions, tensions, known)[0]

    def come_to(
        self, tensions: Array, before: Array, known: Known | None, jumps: bool = True
    ) -> tuple[Linearised, tuple[float, ...]]:
        """Return the equilibrium that the arm comes to, and at which shares of the way it snaps.

        From rest, or from what is `known`, which is an equilibrium under the tensions `before`.
        Raises SnapError where none is found, and where the arm would jump unless it may.
        """
        system = self.system
        of = Question(
            system.arm,
            system.scene,
            system.mesh,
            self._fixed,
            tensions,
            system.of.form.stages,
            self._machine_code,
        )
        if isinstance(known, KnownContact):
            there = _held(known, before)
            moved = self._carried(of, there)
            if moved is not None and _close(there, moved.held):
                return moved.held.here, ()
            way = follow(there.here.system, before, tensions, _at_nodes(there), 1.0, jumps)
        else:
            way = from_rest(system, tensions, self._rest)
        return self._placed(of, way)

    def _carried(self, of: Question, there: Held) -> Settled | None:
        return settled(of, there, _places(there))

    def _placed(self, of: Question, way: Followed) -> tuple[Linearised, tuple[float, ...]]:
        found = settled(of, way.held, places_of(way.held))
        if found is None:
            raise SnapError(1.0, "no places are found where it touches")
        return found.held.here, way.snaps

    def rows(self, here: Linearised) -> tuple[Array, Array]:
        """See Collocation.rows."""
        rows, stretch = Collocation.on(here.system).rows(here)
        return np.hstack([rows, _codes(here.system)]), stretch

    def known(self, rows: Array) -> Known:
        """See ForwardMap.known."""
        system, touches = self._read(rows)
        return KnownContact(system, self.states(rows), touches)

    def settled(self, rows: Array) -> Collocation:
        """Return the map on the mesh that rows have, told of what touches there."""
        if self._last is None or self._last[0] is not rows:
            self._last = rows, Collocation.on(self._read(rows)[0])
        return self._last[1]

    def _read(self, rows: Array) -> tuple[System, Touches]:
        """Return the equations of rows, told of their touches."""
        own = self.system
        stride = own.of.stride
        codes = rows[:, stride + 1 :].reshape(len(rows), -1, _CODES)
        kind = codes[:, :, 0]
        curve = np.where(kind == _POINT, codes[:, :, 1], np.nan)
        curve[curve == 0] = np.nan
        lies = codes[:-1, :, 2] > 0
        touches = Touches(kind == _POINT, kind == _END, kind == _INSIDE, lies, curve)
        mesh = Mesh(rows[:, stride], own.mesh.active)
        stages = own.of.form.stages
        stated = System(own.arm, own.scene, mesh, stages, True, self._machine_code, touches.pressed)
        return touches.told(stated), touches


def _codes(system: System) -> Array:
    """Return arc length and codes of each node (N + 1, 1 + 3 K)."""
    touches = Touches.of(system)
    kind = _POINT * touches.point + _END * touches.end + _INSIDE * touches.inside
    assert touches.curve is not None
    lies = np.vstack([touches.lies, np.zeros_like(touches.lies[:1])])
    codes = np.stack([kind, np.nan_to_num(touches.curve), lies], axis=2)
    return np.hstack([system.mesh.s[:, None], codes.reshape(len(codes), -1)])


def _held(known: KnownContact, tensions: Array) -> Held:
    """Return an equilibrium that is known."""
    system = known.system
    return Held(Linearised(system, system.x(tensions, 1.0, known.states)), known.touches)


def _places(held: Held) -> tuple[Place, ...]:
    """Return the places where an equilibrium touches."""
    s, touches, found = held.here.system.mesh.s, held.touches, list[Place]()
    for j in range(touches.point.shape[1]):
        found += [Place(j, float(at), float(at)) for at in s[touches.point[:, j]]]
        edges = np.diff(touches.lies[:, j].astype(int), prepend=0, append=0)
        pairs = zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True)
        found += [Place(j, float(s[a]), float(s[b])) for a, b in pairs]
    return tuple(found)


def _at_nodes(held: Held) -> Held:
    """Return an equilibrium whose contact is by forces at nodes alone."""
    touches = held.touches
    return replace(held, touches=Touches.at_points(touches.held | touches.inside))


def _close(one: Held, other: Held) -> bool:
    """Return whether no frame turns far between two equilibria."""
    a, b = (held.here.system for held in (one, other))
    before, after = (system.poses(h.states) for system, h in ((a, one), (b, other)))
    there = np.array([np.interp(b.mesh.s, a.mesh.s, column) for column in before[:, :4].T]).T
    there /= np.linalg.norm(there, axis=1)[:, None]
    return bool(np.abs((there * after[:, :4]).sum(axis=1)).min() > np.cos(0.3))


def _density(arm: Arm, scene: Scene, s: Array) -> Array:
    """Return how fast solutions may grow, or contact may change, at s (N,) [1/m]."""
    bodies = numbers_of([contact.obstacle for contact in contacts(scene)])
    small = float((bodies[:, 15] + bodies[:, 12:15].min(axis=1)).min())
    wide = np.maximum(small + arm.outer_radius(s)[0], _SHORTEST * arm.length)
    return np.maximum(growth(arm, scene, s), 0.75 / np.minimum(wide, _LONGEST * arm.length))
