"""Newton's method on the equations of equilibrium with contact, by complementary steps."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.contact.touches import Touches
from model.effects import NeoHookean
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import CLOSE, KEPT, TURN, step_size
from model.obstacles.base import SIZE
from model.paths import Array
from model.time_limit import check_time
from model.transcription.collocation import gauss
from model.transcription.system import System
from model.transcription.touch import TOUCH

_STEPS = 20
# How much of it counts, as of strains: rounding in them is that of forces of the whole arm.
_FELT = 1e-2
# As many again where each may bring some places from sticking to slip or back.
_WITH_FRICTION = 40
_SETTLED = 1e-11
# Forces [N] below this are rounding.
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Held:
    """An equilibrium, linearised there with what touches held shut.

    Attributes
    ----------
    here : Linearised
        Its `system` is told of the touches.
    touches : Touches
    factored : Linearised or None
        The equations linearised where they were factorised last on the way there.
    """

    here: Linearised
    touches: Touches
    factored: Linearised | None = None

    @property
    def states(self) -> Array:
        """The states (n_states,)."""
        return self.here.states

    @cached_property
    def corners(self) -> tuple[float, ...]:
        """Where the arm's surface ends on the base side of arc lengths [m]: a point may stay there.

        That is the tip, and where a body that swells is wider before an anchorage than beyond.
        """
        arm, scene = self.here.system.arm, self.here.system.scene
        return (*(arm.anchorages if scene.has(NeoHookean) else ()), arm.length)

    @property
    def length(self) -> float:
        """The arm's length [m]."""
        return self.here.system.arm.length


def newton(
    system: System,
    tensions: Array,
    load: float,
    states: Array,
    touches: Touches,
    farthest: float = TURN,
    cuts: int = 0,
    kept: Linearised | None = None,
) -> Held | None:
    """Return the equilibrium near given states, None where steps are not small or do not shrink.

    `touches` are what is held shut. See model.equilibrium.newton for `farthest` and `kept`; `cuts`
    is how many steps may be shortened to `farthest`.
    """
    last, grown = 0.0, 0
    frictional, told = system.of.form.contact_friction, touches.told(system)
    for _ in range(_STEPS + _WITH_FRICTION * frictional):
        check_time()
        told = _widened(told, states)
        here = Linearised(told, told.x(tensions, load, states), kept)
        change = here.newton_step()
        if change is None:
            return None
        turn = float(np.abs(change[system.of.nodes[:, :4]]).max())
        moved = states + change
        size = max(step_size(system, change, moved), _rubbed(system, change, moved))
        if kept is not None and not last and size > CLOSE:
            # What was linearised elsewhere is no guide so far.
            kept = None
            continue
        if turn > farthest:
            if cuts == 0:
                return None
            states, cuts, kept = states + farthest / turn * change, cuts - 1, None
            continue
        states = moved
        if size < _SETTLED or size**2 < _SETTLED * last:
            told = _widened(told, states)
            found = Linearised(told, told.x(tensions, load, states))
            return Held(found, touches, here.near or here)
        grown += bool(last and size > last / 2 and size > 1e-6)
        if grown > 4 and not frictional:
            return None
        # Factors are kept while steps contract as fast by them as this: see equilibrium.newton.
        shrinks = size < (KEPT * last if last else CLOSE)
        kept = (here.near or here) if shrinks and not frictional else None
        last = size
    return None


def _widened(system: System, states: Array) -> System:
    """Return equations whose gaps are taken with the larger radius of both sides of each node.

    Friction at a point lets the stretch jump, and with it the radius of a body that swells.
    """
    of, scene = system.of, system.scene
    if not (of.form.contact_friction and scene.has(NeoHookean)):
        return system
    i, method = 2 + of.form.law.torsion, gauss(of.form.stages)
    stretch = states[of.stages[:, i]].reshape(of.elements, -1)
    before, beyond = stretch @ method.at(1.0), np.roll(stretch @ method.at(0.0), -1)
    beyond[-1] = before[-1]
    found = copy.copy(system)
    found.p = system.p.copy()
    rows = found.p[of.equations.numbers_of("touch")].reshape(of.elements, -1, TOUCH)
    radius = np.asarray(system.arm.outer_radius(system.mesh.s[1:])[0])
    rows[:, :, SIZE] = (radius * np.sqrt(np.maximum(before / beyond, 1.0)))[:, None]
    return found


def _rubbed(system: System, change: Array, states: Array) -> float:
    """Return how much friction changes in a step, over the largest force of contact.

    Strains may be too stiff to tell.
    """
    if not system.of.form.contact_friction:
        return 0.0
    of, h = system.of, float(np.diff(system.mesh.s).mean())
    most = np.abs(states[of.touches[:, :, 0]]).max()
    size = max(np.abs(change[of.friction_forces]).max(), h * np.abs(change[of.tractions]).max())
    return float(size / max(most, _ROUNDING)) * _FELT
