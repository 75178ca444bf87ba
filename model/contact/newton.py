"""Newton's method on the equations of equilibrium with contact.

What touches is prescribed; or at the nodes forces and gaps are complementary, f >= 0, gap >= 0,
f gap = 0, of which each step takes gap = 0 where the one before pressed, or was deepest inside.
"""

from __future__ import annotations

import copy

import numpy as np
from scipy.ndimage import minimum_filter1d

from model.contact.gaps import gaps_along
from model.contact.touches import Touches, forces, kernel_numbers
from model.effects import NeoHookean
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import CLOSE, KEPT, SETTLED, TURN, step_sizes
from model.obstacles.base import SIZE
from model.paths import Array
from model.progress import check_time
from model.transcription.system import System

# Steps at most, each of which may bring some places from sticking to slip or back, or other nodes
# into touch.
STEPS = 30
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
    last, kept, rubs = 0.0, None, system.of.form.contact_friction
    for _ in range(STEPS):
        check_time()
        if complementary:
            before, system = system, _active(system, states)
            kept = kept if np.array_equal(before.p, system.p) else None
        elif rubs and system.scene.has(NeoHookean):
            system = _widened(system, states)
        point = Linearised(system, system.x(tensions, load, states), kept)
        change = point.newton_step()
        if change is None:
            return None
        turn, size = step_sizes(system, change, states)
        size = max(size, _rubbed(system, change, states)) if rubs else size
        states = states + min(1.0, TURN / max(turn, TURN)) * change
        if turn <= TURN and (size < SETTLED or size**2 < SETTLED * last):
            return Linearised(system, system.x(tensions, load, states))
        contracts = size < (KEPT * last if last else CLOSE)
        kept, last = (kept or point) if contracts and not rubs else None, size
    return None


def _active(system: System, states: Array) -> System:
    """Return equations with nodes that touch: those that press, and the deepest inside."""
    gap, touches = gaps_along(system, states, 1)[1], Touches.of(system)
    deepest = (gap < 0) & (gap <= minimum_filter1d(gap, 3, 0))
    presses = forces(system, states)[1:] > 0
    touches.held[1:] = np.where(touches.points[1:], presses, deepest)
    return touches.on(system)


def _widened(system: System, states: Array) -> System:
    """Return equations whose gaps are taken with the larger radius of both sides of each node.

    Friction at a point lets the stretch jump, and with it the radius of a body that swells.
    """
    before, beyond = system.stretch_beside(states[system.of.stages])
    widened, radius = copy.copy(system), system.arm.outer_radius(system.mesh.s[1:])[0]
    wider = radius * np.sqrt(np.maximum(before / beyond, 1.0))
    kernel_numbers(widened, "touch")[:, :, SIZE] = wider[:, None]
    return widened


def _rubbed(system: System, change: Array, states: Array) -> float:
    """Return how much friction changes in a step, over the largest force of contact.

    Strains may be too stiff to tell.
    """
    of, h = system.of, float(np.diff(system.mesh.s).mean())
    most = max(np.abs(forces(system, states)).max(), _ROUNDING)
    size = max(np.abs(change[of.friction_forces]).max(), h * np.abs(change[of.tractions]).max())
    return float(size / most) * _FRICTION
