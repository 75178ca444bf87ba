"""Which nodes of a mesh touch which obstacles, and how: what the kernels of contact are told."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.paths import Array
from model.rotations import matrices
from model.transcription.contact_friction import BEFORE, FRICTION
from model.transcription.contact_friction import TOLD as FRICTION_TOLD
from model.transcription.system import System
from model.transcription.touch import PRESSURE, TOLD, TOUCH

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Touches:
    """How nodes touch obstacles; where all is False the arm is free.

    Attributes
    ----------
    point : (N + 1, K)
        Nodes at which a force holds the gap to each of K obstacles shut.
    end : (N + 1, K)
        Nodes where a part that lies on an obstacle begins or ends: force and pressure.
    inside : (N + 1, K)
        Nodes inside of such a part: pressure alone.
    lies : (N, K)
        Elements that such parts consist of.
    curve : (N + 1, K) or None
        gap'' [1/m] where points may move along the arm, nan elsewhere; None where nodes stay.
    pressing : (N + 1, K, 2) or None
        Forces [N] and pressures [N/m] that friction is told instead of what presses.
    """

    point: Mask
    end: Mask
    inside: Mask
    lies: Mask
    curve: Array | None = None
    pressing: Array | None = None

    @classmethod
    def none(cls, elements: int, obstacles: int) -> Touches:
        """Return those of a free arm."""
        nodes = np.zeros((elements + 1, obstacles), dtype=bool)
        return cls(nodes, nodes, nodes, nodes[1:])

    @classmethod
    def at_points(cls, point: Mask) -> Touches:
        """Return those of forces at nodes (N + 1, K)."""
        none = np.zeros_like(point)
        return cls(point, none, none, none[1:])

    @classmethod
    def of(cls, system: System) -> Touches:
        """Return those that a system is told of."""
        of = system.of
        rows = system.p[of.equations.numbers_of("touch")].reshape(of.elements, -1, TOUCH)
        held, inside, end, moves, curve = np.moveaxis(rows[:, :, -TOLD:], 2, 0)
        first = np.zeros((1, held.shape[1]))
        held, inside, end, moves, curve = (
            np.vstack([first, part]) for part in (held, inside, end, moves, curve)
        )
        lies = np.zeros(inside[1:].shape, dtype=bool)
        if of.form.pressed:
            own = system.p[of.equations.numbers_of("pressure")]
            lies = own.reshape(of.elements, -1, PRESSURE)[:, :, -1] > 0
        at_point = (held > 0) & (end == 0)
        return cls(at_point, end > 0, inside > 0, lies, np.where(moves > 0, curve, np.nan))

    @property
    def held(self) -> Mask:
        """Nodes with a force (N + 1, K)."""
        return self.point | self.end

    @property
    def pressed(self) -> bool:
        """Whether the arm lies on anything."""
        return bool(self.lies.any())

    def like(self, other: Touches) -> bool:
        """Return whether the same nodes touch in the same way, be it elsewhere."""
        pairs = zip(self._masks, other._masks, strict=True)
        return all(np.array_equal(one, two) for one, two in pairs)

    @property
    def _masks(self) -> tuple[Mask, ...]:
        return self.point, self.end, self.inside, self.lies, self.moves

    @property
    def moves(self) -> Mask:
        """Nodes that touch at points which may move along the arm (N + 1, K)."""
        return np.zeros_like(self.point) if self.curve is None else ~np.isnan(self.curve)

    def told(self, system: System) -> System:
        """Return a system whose kernels of contact are told of these touches."""
        found, of = copy.copy(system), system.of
        found.p = system.p.copy()
        rows = found.p[of.equations.numbers_of("touch")].reshape(-1, TOUCH)
        moves = self.moves
        curve = np.zeros_like(moves) if self.curve is None else np.nan_to_num(self.curve)
        flags = [self.held, self.inside, self.end, moves, curve]
        rows[:, -TOLD:] = np.stack(flags, axis=2)[1:].reshape(-1, TOLD)
        if of.form.pressed:
            found.p[of.equations.numbers_of("pressure")].reshape(-1, PRESSURE)[:, -1] = (
                self.lies.ravel()
            )
        if of.form.contact_friction:
            tangential = found.p[of.equations.numbers_of("contact_friction")].reshape(-1, FRICTION)
            first = self.end & np.vstack([self.lies, np.zeros_like(self.lies[:1])])
            flags = [self.held, self.inside, self.end & ~first, first, moves, *self._pressing()]
            tangential[:, -BEFORE - FRICTION_TOLD : -BEFORE] = np.stack(flags, axis=2)[1:].reshape(
                -1, FRICTION_TOLD
            )
        return found

    def _pressing(self) -> list[Array]:
        """Return whether it is given (N + 1, K), P and p there, and p before and beyond."""
        if self.pressing is None:
            return [np.zeros(self.point.shape)] * 5
        P, p = np.moveaxis(self.pressing, 2, 0)
        none = np.zeros_like(p[:1])
        return [np.ones_like(p), P, p, np.vstack([none, p[:-1]]), np.vstack([p[1:], none])]


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
    p = second(system, states) * (touches.end | touches.inside)
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
    p = second(system, states) * (touches.end | touches.inside)
    spread = resultants(system, states, touches) - forces(system, states) * touches.held
    length = np.divide(spread, p, out=np.zeros_like(p), where=p > 0)
    frames = matrices(system.poses(states)[:, :4])
    tau = np.einsum("nij,nkj->nki", frames, states[of.tractions])
    return np.asarray(states[of.friction_forces] + length[:, :, None] * tau)
