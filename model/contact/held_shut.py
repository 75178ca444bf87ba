"""The equilibrium of an arm with places held shut, on a mesh that has them as nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.arm import Arm
from model.contact.along import along
from model.contact.history import History
from model.contact.newton import Held, newton
from model.contact.places import Place, Placed, placed
from model.contact.touches import Touches, forces, second
from model.effects import Shear
from model.equilibrium.forward import Collocation
from model.loads import contacts
from model.mesh import Mesh
from model.paths import Array
from model.scene import Scene
from model.transcription.system import System

# gap'' [1/m] that counts as flat, and what points move by instead, over 1 / L: to lesser gaps.
_FLAT, _BENT = 1e-3, 4.0
# Of an element: the farthest that its nodes may have moved for its states to be kept, and factors.
_KEPT, _FACTORED = 0.2, 0.02
# How far from a node points may have moved, over an element, for gap'' to be that at the node.
_BESIDE = 0.01

# Of each place the nodes of its ends.
Nodes = tuple[tuple[int, ...], ...]


@dataclass(frozen=True, eq=False)
class Question:
    """What is asked for on a mesh that may move.

    Attributes
    ----------
    arm, scene
    base : Mesh
        That nodes are moved from.
    fixed : (n,)
        Arc lengths of nodes that stay [m].
    tensions : (n_tendons,)
    load : float
        Load factor.
    stages : int
    machine_code : bool
    history : History or None
        Where the arm was before, that friction looks back to.
    """

    arm: Arm
    scene: Scene
    base: Mesh
    fixed: Array
    tensions: Array
    load: float
    stages: int
    machine_code: bool = False
    history: History | None = None

    def system(self, mesh: Mesh, pressed: bool = False) -> System:
        """Return the equations on a mesh."""
        form = self.stages, True, self.machine_code, pressed
        found = System(self.arm, self.scene, mesh, *form)
        if self.history is not None and found.of.form.contact_friction:
            self.history.told(found)
        return found


def held_shut(
    of: Question, held: Held, places: tuple[Place, ...], pressing: Held | None
) -> tuple[Held, Nodes] | None:
    """Return the equilibrium with places held shut, and their nodes.

    With friction as of the pressures of another equilibrium, if one is given.
    """
    K = len(contacts(of.scene))
    at = placed(of.base, of.fixed, places, K, of.scene.has(Shear))
    if at is None:
        return None
    before = held.here
    system = of.system(at.mesh, at.touches.pressed)
    touches = replace(at.touches, curve=_curves(held, places, at))
    if pressing is not None:
        touches = replace(touches, pressing=_pressing(pressing, system, touches))
    kept = None
    if _near(before.system, system, _KEPT):
        states = before.states.copy()
        if _near(before.system, system, _FACTORED) and touches.like(held.touches):
            kept = held.factored
    else:
        states = Collocation.on(system).carried(of.tensions, before)
        states[system.of.touches[:, :, 0]] = _carried(held, system, touches)
        if before.system.of.form.contact_friction:
            near = np.abs(system.mesh.s[:, None] - before.system.mesh.s).argmin(axis=1)
            old = before.system.of
            states[system.of.friction_forces] = before.states[old.friction_forces[near]]
            states[system.of.tractions] = before.states[old.tractions[near]]
    own = system.of.touches
    if system.of.form.contact_friction:
        states[system.of.friction_forces] *= touches.held[:, :, None]
        states[system.of.tractions] *= (touches.inside | touches.end)[:, :, None]
    states[own[:, :, 1]] *= touches.inside | touches.end
    states[own[:, :, 0]] *= touches.held
    given = of.tensions, of.load, states, touches
    found = newton(system, *given, cuts=4, kept=kept)
    return None if found is None else (found, at.nodes)


def _near(before: System, after: System, most: float) -> bool:
    """Return whether nodes of two meshes are where they were, but for a share of an element."""
    old, new = before.mesh, after.mesh
    if before.of.stride != after.of.stride or old.s.size != new.s.size:
        return False
    h = np.minimum(np.diff(old.s), np.diff(new.s)).min()
    return bool(np.abs(old.s - new.s).max() < most * h)


def _carried(held: Held, system: System, touches: Touches) -> Array:
    """Return forces (N + 1, K) to begin with on another mesh: of each obstacle those nearest."""
    old, s, found = (
        forces(held.here.system, held.states),
        system.mesh.s,
        np.zeros(touches.held.shape),
    )
    for k, j in zip(*np.nonzero(old), strict=True):
        there = np.flatnonzero(touches.held[:, j])
        if there.size:
            near = there[np.argmin(np.abs(s[there] - held.here.system.mesh.s[k]))]
            found[near, j] += old[k, j]
    return found


def _pressing(before: Held, system: System, touches: Touches) -> Array:
    """Return forces and pressures (N + 1, K, 2) of an equilibrium on another mesh."""
    old = before.here.system
    p = second(old, before.states) * (before.touches.inside | before.touches.end)
    own = np.array([np.interp(system.mesh.s, old.mesh.s, column) for column in p.T]).T
    return np.stack([_carried(before, system, touches), own], axis=2)


def _curves(before: Held, places: tuple[Place, ...], at: Placed) -> Array:
    """Return gap'' where points may move (N + 1, K), nan elsewhere."""
    system, found = before.here.system, np.full(at.touches.point.shape, np.nan)
    free = [i for i, p in enumerate(places) if not p.lies and p.start not in before.corners]
    if free:
        s = _at_nodes(system.mesh, np.array([places[i].start for i in free]))
        j = np.array([places[i].obstacle for i in free])
        curve = along(system, before.here.x, s, j)[:, 2]
        found[[at.nodes[i][0] for i in free], j] = np.where(
            curve > _FLAT, curve, _BENT / system.arm.length
        )
    return found


def _at_nodes(mesh: Mesh, s: Array) -> Array:
    """Return arc lengths (n,), those next to nodes at them, where gaps cost less."""
    k = np.abs(mesh.s - s[:, None]).argmin(axis=1)
    near = np.abs(mesh.s[k] - s) < _BESIDE * np.diff(mesh.s).min()
    return np.asarray(np.where(near, mesh.s[k], s))
