"""Newton's method on the equations of equilibrium with contact.

What touches is prescribed; or at the nodes forces and gaps are complementary, f >= 0, gap >= 0,
f gap = 0, of which each step takes gap = 0 where the one before pressed, or was deepest inside.
"""

from __future__ import annotations

import copy

import numpy as np

from model.centreline import Centreline
from model.contact.touches import Touches, forces, kernel_numbers
from model.effects import NeoHookean
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import CLOSE, KEPT, TURN, step_sizes
from model.loads import contacts
from model.obstacles import distances, numbers_of
from model.obstacles.base import SIZE
from model.paths import Array
from model.time_limit import check_time
from model.transcription.system import System

# Steps at most, each of which may bring some places from sticking to slip or back, or other nodes
# into touch; the size of the last one.
_STEPS, _CONVERGED = 30, 1e-11
# How much a change of friction counts as one of strains: rounding in them is that of forces of the
# whole arm. Forces [N] below the second are rounding.
_FRICTION, _ROUNDING = 1e-2, 1e-13


def newton(
    system: System,
    tensions: Array,
    load: float,
    states: Array,
    complementary: bool = False,
) -> Linearised | None:
    """Return the equilibrium near given states; None if steps do not lead to one.

    With the touches that are set on the system, or with complementary forces and gaps at the nodes.
    Steps that rotate frames far are shortened.
    """
    last, kept = 0.0, None
    for _ in range(_STEPS):
        check_time()
        system = _active(system, states) if complementary else system
        widened = _widened(system, states)
        same = kept is not None and np.array_equal(kept.system.p, widened.p)
        point = Linearised(widened, widened.x(tensions, load, states), kept if same else None)
        change = point.newton_step()
        if change is None:
            return None
        turn = float(np.abs(change[system.of.nodes[:, :4]]).max())
        states = states + min(1.0, TURN / max(turn, TURN)) * change
        size = max(float(step_sizes(system, change, states)[1]), _rubbed(system, change, states))
        if turn <= TURN and (size < _CONVERGED or size**2 < _CONVERGED * last):
            widened = _widened(system, states)
            return Linearised(widened, widened.x(tensions, load, states))
        contracts = size < (KEPT * last if last else CLOSE)
        keeps = contracts and not system.of.form.contact_friction
        kept = (point.near or point) if keeps else None
        last = size
    return None


def _active(system: System, states: Array) -> System:
    """Return equations with nodes that touch: those that press, and the deepest inside."""
    line = Centreline.at_states(system, states)
    bodies = numbers_of([contact.obstacle for contact in contacts(system.scene)])
    at = np.arange(system.mesh.steps)
    gap = distances(bodies, line.poses[1:, 4:])[0] - line.radius(at, np.ones(at.size))[:, None]
    wide = np.pad(gap, ((1, 1), (0, 0)), constant_values=np.inf)
    deepest = (gap < 0) & (gap <= wide[:-2]) & (gap <= wide[2:])
    touches, before = Touches.none(system), Touches.of(system).points[1:]
    touches.held[1:] = np.where(before, forces(system, states)[1:] > 0, deepest)
    return touches.on(system)


def _widened(system: System, states: Array) -> System:
    """Return equations whose gaps are taken with the larger radius of both sides of each node.

    Friction at a point lets the stretch jump, and with it the radius of a body that swells.
    """
    of, scene = system.of, system.scene
    if not (of.form.contact_friction and scene.has(NeoHookean)):
        return system
    before, beyond = system.stretch_beside(system.strains(states))
    widened = copy.copy(system)
    widened.p = system.p.copy()
    radius = np.asarray(system.arm.outer_radius(system.mesh.s[1:])[0])
    kernel_numbers(widened, "touch")[:, :, SIZE] = (
        radius[:, None] * np.sqrt(np.maximum(before / beyond, 1.0))[:, None]
    )
    return widened


def _rubbed(system: System, change: Array, states: Array) -> float:
    """Return how much friction changes in a step, over the largest force of contact.

    Strains may be too stiff to tell.
    """
    if not system.of.form.contact_friction:
        return 0.0
    of, h = system.of, float(np.diff(system.mesh.s).mean())
    most = np.abs(states[of.touches[:, :, 0]]).max()
    size = max(np.abs(change[of.friction_forces]).max(), h * np.abs(change[of.tractions]).max())
    return float(size / max(most, _ROUNDING)) * _FRICTION
