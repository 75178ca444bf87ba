"""Loads that change on an arm in equilibrium, such as a payload that a bent arm picks up.

The numbers of the equations change in a straight line from one loading to the other.
"""

from __future__ import annotations

from copy import copy

from octoplan.model.effects.base import Effect
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.newton import CHORD_RADIUS, Start, newton
from octoplan.model.equilibrium.stability import is_stable
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.scene import Scene
from octoplan.model.support.progress import check_time

# Smallest change of the loads in one step, over the whole change.
_LEAST_STEP = 1 / 1024


def with_loads_of(scene: Scene, other: Scene) -> Scene | None:
    """Return a scene with the loads of another one, as far as they are of the same kinds.

    Loads that the other scene lacks are 0 in the result, so that both scenes have equations of one
    structure. Return None if the scenes differ in more, or if the other one has further loads.
    """
    known = {(type(each), each.place): each for each in other.effects}
    effects = list[Effect]()
    for effect in scene.effects:
        before = known.pop((type(effect), effect.place), None)
        if before is None:
            before = effect.without_force()
        elif before.without_force() != effect.without_force():
            return None
        if before is None:
            return None
        effects.append(before)
    return None if known else Scene(*effects)


def change_loads(system: DiscreteRod, begin: Equilibrium, strains: Array) -> Equilibrium | None:
    """Return the equilibrium under the loads of a system, on the branch of one under other loads.

    Parameters
    ----------
    system : DiscreteRod
        The equations with the new loads.
    begin : Equilibrium
        The equilibrium under the old loads, whose tensions stay.
    strains : (N stages, strains)
        Its strains at the stages of the system.

    Returns
    -------
    Equilibrium or None
        None if the arm snaps, folds or buckles on the way, or if the scenes differ in more than
        their loads.
    """
    scene = with_loads_of(system.scene, begin.system.scene)
    if scene is None:
        return None
    before = system.on_mesh(system.mesh, scene)
    if before.layout is not system.layout:
        return None
    states = before.initial_states(begin.tensions, strains, 1.0)
    (point,) = newton(before, [Start(begin.tensions, 1.0, states, history="near")], CHORD_RADIUS)
    change = system.p - before.p
    fraction = 0.0
    step = 1.0
    while point is not None and fraction < 1 and step >= _LEAST_STEP:
        check_time()
        step = min(step, 1 - fraction)
        after = copy(system)
        after.p = before.p + (fraction + step) * change
        guess = point.states - point.solve(after.residual(point.x))
        (there,) = newton(after, [Start(begin.tensions, 1.0, guess, history="near")])
        if there is None or not is_stable(there):
            step /= 2
            continue
        point = there
        fraction += step
        step *= 2
    return point if fraction == 1 else None
