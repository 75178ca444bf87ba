"""Tensions to equilibria by collocation: Newton's method, and load stepping from rest.

Newton's steps are bounded and have to contract; the branch of the arm without loads is followed up
to the full loads, in one step if that is safe.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from model.equilibrium.linearised import Equilibrium, Linearised
from model.equilibrium.stability import stands
from model.errors import SnapError, UnsettledSectionError
from model.loads import is_loaded
from model.paths import Array
from model.progress import check_time, tell
from model.transcription.collocation import gauss
from model.transcription.system import System

# Of an element, unless a scheme asks for fewer.
STAGES = 3
# Steps at most; those in contact may each bring places from sticking to slip or back, or other
# nodes into touch.
STEPS, STEPS_IN_CONTACT = 14, 30
# The size of the last step: larger where its factorisation is of the same point, as the next one
# would be its square.
SETTLED, LEFT = 1e-10, 1e-13
# A step counts as safe if it is so much smaller than the last; below SMALL rounding may be felt.
CONTRACTION, SMALL = 0.5, 1e-3
# The farthest that a frame may rotate in one step of the load factor [rad]; in one of Newton's, as
# a change of its quaternion. So far ahead a tangent is trusted too [rad].
FOLLOWED = 1.2
TURN = FOLLOWED / 2
# How many times larger last steps may be where the equilibrium is there to begin the next one with.
ROUGHEST = 1e6
# Guesses by another mesh are so near; the factorisation is kept after a step so small, and as long
# as steps contract so fast: a residual costs a tenth of a factorised Jacobian.
CLOSE, KEPT = 0.02, 0.1
# How much a change of friction counts as one of strains: rounding in them is that of forces of the
# whole arm. Forces [N] below the second are rounding.
_FRICTION, _ROUNDING = 1e-2, 1e-13


def newton(
    system: System,
    tensions: Array,
    load: float,
    states: Array,
    farthest: float = TURN,
    near: Linearised | None = None,
    looser: float = 1.0,
    touching: Callable[[System, Array], System] | None = None,
) -> Linearised | None:
    """Return the equilibrium near given states (n_states,) under tensions (n_tendons,).

    None where steps are not small or do not contract: that keeps to the branch of the states. In
    contact, where what touches may change in each, steps that rotate frames far are shortened.

    Parameters
    ----------
    farthest : float
        How far one step may rotate a frame.
    near : Linearised
        The equations linearised nearby, whose factorisation is begun with.
    looser : float
        How many times larger the last steps may be; the root of that for how far from where they
        were linearised the equations count as such.
    touching : callable
        Equations in contact and states -> the equations with what touches at these states.
    """
    near = near and (near.near or near)
    before, path, rubs = 0.0, np.inf, system.of.form.contact_friction
    far = CLOSE if near is None else np.inf
    for _ in range(STEPS_IN_CONTACT if touching else STEPS):
        check_time()
        if touching:
            system, last = touching(system, states), system
            near = near if np.array_equal(system.p, last.p) else None
        point = Linearised(system, system.x(tensions, load, states), near)
        step = point.newton_step()
        if step is None:
            return None
        path = 0.0 if near is None else path
        level = looser * (SETTLED if near is None else LEFT)
        near = point.near or point
        rotation, size = step_sizes(system, step, states + step)
        path += size
        contracts = not before or size <= max(CONTRACTION * before, SMALL)
        if not touching and (rotation > farthest or not contracts):
            return None
        # Where it sticks and slips by turns half a step leads on.
        share = 0.5 if rubs and not contracts else 1.0
        states = states + min(share, farthest / max(rotation, farthest)) * step
        if rotation <= farthest and (size < level or size**2 < level * before):
            # So near to where they were linearised the equations have the same derivatives.
            is_close = path < math.sqrt(SETTLED * looser) and not rubs
            x = system.x(tensions, load, states)
            return Linearised(system, x, near if is_close else None)
        if rubs or size > (KEPT * before if before else far):
            near = None
        before = size
    return None


def step_sizes(system: System, step: Array, states: Array) -> tuple[float, float]:
    """Return how far a step (n_states,) rotates a frame at most, as a change of its quaternion.

    And its size, of that, of strains relative to these, curvatures to 1 / L at least, and of
    friction of contacts relative to the largest force: strains may be too stiff to tell of it.
    """
    of = system.of
    rotation = float(np.abs(step[of.nodes[:, :4]]).max())
    changes = np.abs(step[of.stages]) / (system.units + np.abs(states[of.stages]))
    size = max(rotation, float(changes.max()))
    if of.form.contact_friction:
        h = float(np.diff(system.mesh.s).mean())
        rubs = max(np.abs(step[of.friction_forces]).max(), h * np.abs(step[of.tractions]).max())
        most = max(np.abs(states[of.touches[:, :, 0]]).max(), _ROUNDING)
        size = max(size, float(rubs / most) * _FRICTION)
    return rotation, size


# The least step in the load factor over what is reached; before the first step, over itself.
LEAST_STEP = 1 / 8192
SNAPS, BUCKLES = "it snaps or folds", "it buckles"


class Followed(NamedTuple):
    """The last equilibrium on a branch, the load factor there, and what happens beyond."""

    point: Linearised
    load: float
    why: str


def follow_on(
    start: Followed,
    most: float,
    least: float,
    crushed: Callable[[], object] | None = None,
    looser: float = 1.0,
    on_the_way: float = 1.0,
) -> Followed:
    """Follow a branch on from an equilibrium, up to a load factor.

    No step is so long that the tangent turns a frame far. One that leads to no
    equilibrium is halved; the end is where it is down to `least` of the load factor that is
    reached, or soon where the arm is `crushed` without loads. `looser` is newton's; on the way,
    until a step fails, `on_the_way` is.
    """
    at, step, tried, system = start, min(1.0, most), 0, start.point.system
    n, quaternions = system.of.n_tendons, system.of.nodes[:, :4]
    begins_stable: bool | None = None
    while at.load < most and step >= least * max(at.load, least):
        check_time()
        if tried == _SOON_IF_CRUSHED and crushed and crushed():
            break
        tried += 1
        tell("percent of the loads", round(100 * at.load / most), 100)
        if at.point.factor is None:
            return at._replace(why=BUCKLES)
        rate, step = at.point.by_unknowns(n, n + 1)[:, 0], min(step, most - at.load)
        turned = 2 * step * float(np.abs(rate[quaternions]).max())
        load = at.load + step * min(1.0, TURN / max(turned, TURN))
        change, level = (load - at.load) * rate, looser if load == most else on_the_way
        point = newton(system, at.point.tensions, load, at.point.states + change, looser=level)
        if point is not None:
            cosines = (at.point.states[quaternions] * point.states[quaternions]).sum(axis=1)
            point = None if np.abs(cosines).min() <= np.cos(FOLLOWED / 2) else point
        stable = point is not None and stands(point)
        if point is not None and not stable and begins_stable is None:
            # What is unstable without loads, or where it begins, is not their doing.
            begins_stable = stands(start.point)
        if point is None or (not stable and begins_stable):
            why = SNAPS if point is None else BUCKLES
            at, step, on_the_way = at._replace(why=why), (load - at.load) / 2, 1.0
        else:
            at, step = Followed(point, load, ""), 2 * step
    return at


# Where a tendon has no length left any load moves it by many times the width that keeps its root
# smooth: steps in the loads shrink with that, and come to an end in a few or not at all.
_SOON_IF_CRUSHED = 30


class Collocation:
    """The equations of an arm on a mesh, which settle tensions to equilibria.

    Attributes
    ----------
    system : System
    """

    def __init__(self, system: System) -> None:
        self.system, self.mesh, self._loaded = system, system.mesh, is_loaded(system.scene)

    def solve(
        self, tensions: Array, near: Equilibrium | None = None, looser: float = 1.0
    ) -> Linearised:
        """Return the equilibrium under tensions (n_tendons,), near that of another mesh if any is.

        Else the one from rest, see `from_rest`; raises what that does.
        """
        if isinstance(near, Linearised) and self._loaded:
            point = newton(self.system, tensions, 1.0, self.carried(tensions, near), CLOSE)
            if point is not None:
                return point
        return self.from_rest(tensions, looser)

    def from_rest(self, tensions: Array, looser: float = 1.0) -> Linearised:
        """Return the equilibrium that the unloaded arm comes to under tensions (n_tendons,).

        Without loads the states that loads would begin from are the equilibrium. The last steps of
        Newton's method may be so many times `looser` than elsewhere. Raises SnapError,
        which says where its branch ends or loses its stability, and UnsettledSectionError where a
        section has none, or tensions that leave a tendon no length keep loads from being applied in
        steps.
        """
        at, strains = self.system, self.system.sections.strains(tensions)
        x = at.x(tensions, 1.0 - self._loaded, at.start(tensions, strains))
        point = Linearised(at, x)
        if not self._loaded:
            return point
        begin, crushed = Followed(point, 0.0, ""), partial(at.sections.crushed, strains)
        end = follow_on(begin, 1.0, LEAST_STEP, crushed, looser, ROUGHEST)
        if end.load >= 1:
            return end.point
        if section := crushed():
            raise UnsettledSectionError(section.s)
        raise SnapError(end.load, end.why or SNAPS)

    def led_to(self, at: Linearised, tensions: Array) -> Linearised | None:
        """Return the equilibrium under tensions near another of this mesh; None for none."""
        of, change = at.system.of, at.by_tensions @ (tensions - at.tensions)
        is_close = step_sizes(at.system, change, at.states)[1] < CLOSE
        load, states = float(at.x[of.n_tendons]), at.states + change
        return newton(at.system, tensions, load, states, near=at if is_close else None)

    def without_loads(self, tensions: Array) -> Array:
        """Return the states under tensions without loads; raises UnsettledSectionError."""
        return self.system.start(tensions, self.system.sections.strains(tensions))

    def carried(self, tensions: Array, near: Linearised) -> Array:
        """Return the states of this mesh by the polynomials of another's strains.

        Where tensions differ, of the states at these by its derivatives.
        """
        before, states = near.system, predicted(near, tensions)
        if before.of is self.system.of and np.array_equal(before.mesh.s, self.mesh.s):
            return states
        strains = carried_strains(before, states[before.of.stages], self.system)
        return self.system.start(tensions, strains, 1.0)


def predicted(near: Linearised, tensions: Array) -> Array:
    """Return states under tensions (n_tendons,) by the derivatives of an equilibrium nearby."""
    if np.array_equal(tensions, near.tensions):
        return near.states
    return near.states + near.by_tensions @ (tensions - near.tensions)


def carried_strains(before: System, strains: Array, after: System) -> Array:
    """Return the strains (N stages, ...) at the stages of a mesh by those of another's stages."""
    mesh, m = before.mesh, before.of.form.stages
    step = np.clip(np.searchsorted(mesh.s, after.s) - 1, 0, before.of.elements - 1)
    x = (after.s - mesh.s[step]) / np.diff(mesh.s)[step]
    by_element = strains.reshape(before.of.elements, m, *strains.shape[1:])
    return np.asarray(np.einsum("nm,nm...->n...", gauss(m).at(x), by_element[step]))
