"""Which nodes of a mesh touch which obstacles, and how: what the kernels of contact are told."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.paths import Array
from model.rotations import matrices
from model.transcription.system import System
from model.transcription.touch import BEFORE, FRICTION, FRICTION_TOLD, PRESSURE, TOLD, TOUCH

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Touches:
    """How nodes touch obstacles; where all is False the arm is free.

    Attributes
    ----------
    point : (N + 1, K)
        Nodes at which a force keeps the gap to each of K obstacles at 0.
    end : (N + 1, K)
        Nodes where a part that lies on an obstacle begins or ends: force and pressure.
    inside : (N + 1, K)
        Nodes inside of such a part: pressure alone.
    lies : (N, K)
        Elements that such parts consist of.
    curve : (N + 1, K)
        gap'' [1/m] of points that may move along the arm, above 0; 0 where nodes stay.
    """

    point: Mask
    end: Mask
    inside: Mask
    lies: Mask
    curve: Array

    @classmethod
    def none(cls, elements: int, obstacles: int) -> Touches:
        """Return those of a free arm."""
        nodes = elements + 1, obstacles
        point, end, inside = (np.zeros(nodes, dtype=bool) for _ in range(3))
        return cls(point, end, inside, np.zeros((elements, obstacles), dtype=bool), np.zeros(nodes))

    @classmethod
    def of(cls, system: System) -> Touches:
        """Return those that a system is told of."""
        of = system.of
        found = cls.none(of.elements, of.form.contacts)
        rows = system.p[of.equations.numbers_of("touch")].reshape(of.elements, -1, TOUCH)
        held, inside, end, _, curve = np.moveaxis(rows[:, :, -TOLD:], 2, 0)
        found.point[1:], found.end[1:] = (held > 0) & (end == 0), end > 0
        found.inside[1:], found.curve[1:] = inside > 0, curve
        if of.form.pressed:
            own = system.p[of.equations.numbers_of("pressure")]
            found.lies[:] = own.reshape(of.elements, -1, PRESSURE)[:, :, -1] > 0
        return found

    @property
    def held(self) -> Mask:
        """Nodes with a force (N + 1, K)."""
        return self.point | self.end

    @property
    def moves(self) -> Mask:
        """Nodes that touch at points which may move along the arm (N + 1, K)."""
        return np.asarray(self.curve > 0)

    @property
    def pressing(self) -> Mask:
        """Nodes with a pressure (N + 1, K)."""
        return self.end | self.inside

    def like(self, other: Touches) -> bool:
        """Return whether the same nodes touch in the same way, be it elsewhere."""
        ours, theirs = (
            (own.point, own.end, own.inside, own.lies, own.moves) for own in (self, other)
        )
        return all(map(np.array_equal, ours, theirs))

    def told(self, system: System) -> System:
        """Return a system whose kernels of contact are told of these touches."""
        found, of = copy.copy(system), system.of
        found.p = system.p.copy()
        rows = found.p[of.equations.numbers_of("touch")].reshape(-1, TOUCH)
        flags = [self.held, self.inside, self.end, self.moves, self.curve]
        rows[:, -TOLD:] = np.stack(flags, axis=2)[1:].reshape(-1, TOLD)
        if of.form.pressed:
            own = found.p[of.equations.numbers_of("pressure")].reshape(-1, PRESSURE)
            own[:, -1] = self.lies.ravel()
        if of.form.contact_friction:
            rubbed = found.p[of.equations.numbers_of("contact_friction")].reshape(-1, FRICTION)
            first = self.end & np.vstack([self.lies, np.zeros_like(self.lies[:1])])
            flags = [self.held, self.inside, self.end & ~first, first, self.moves]
            rubbed[:, -BEFORE - FRICTION_TOLD : -BEFORE] = np.stack(flags, axis=2)[1:].reshape(
                -1, FRICTION_TOLD
            )
        return found


def forces(system: System, states: Array) -> Array:
    """Return the contact force of each node on each obstacle (N + 1, K) [N]."""
    return np.asarray(states[system.of.touches[:, :, 0]])


def second(system: System, states: Array) -> Array:
    """Return the second unknown of each node and obstacle (N + 1, K): pressure [N/m], or a shift.

    The shift [m] is how far on along the arm a point touches.
    """
    return np.asarray(states[system.of.touches[:, :, 1]])


def resultants(system: System, states: Array, touches: Touches) -> Array:
    """Return the forces with which obstacles press at the nodes (N + 1, K) [N].

    Of a pressure that is linear between nodes what falls to each by the lever rule.
    """
    p = second(system, states) * touches.pressing
    before, here, beyond = pressure_shares(system, touches.lies)
    found = forces(system, states) * touches.held + here * p
    found[1:] += before[1:] * p[:-1]
    found[:-1] += beyond[:-1] * p[1:]
    return found


def pressure_shares(system: System, lies: Mask) -> tuple[Array, Array, Array]:
    """Return how much of the pressures before, at and beyond each node falls to it (N + 1, K) [m].

    By the lever rule, of elements that lie (N, K).
    """
    h, none = np.diff(system.mesh.s)[:, None] * lies, np.zeros((1, lies.shape[1]))
    before, beyond = np.vstack([none, h]) / 6, np.vstack([h, none]) / 6
    return before, 2 * (before + beyond), beyond


def frictions(system: System, states: Array, touches: Touches) -> Array:
    """Return the friction at each node from each obstacle (N + 1, K, 3) [N], 0 without any.

    Of the traction between nodes as much falls to each as of the pressure.
    """
    of = system.of
    if not of.form.contact_friction:
        return np.zeros((of.elements + 1, of.form.contacts, 3))
    p = second(system, states) * touches.pressing
    spread = resultants(system, states, touches) - forces(system, states) * touches.held
    length = np.divide(spread, p, out=np.zeros_like(p), where=p > 0)
    frames = matrices(system.poses(states)[:, :4])
    tau = np.einsum("nij,nkj->nki", frames, states[of.tractions])
    return np.asarray(states[of.friction_forces] + length[:, :, None] * tau)
