"""Change of the loads of an arm in equilibrium, such as a payload that a bent arm picks up.

The parameters of the equations change along a straight line from the old loads to the new loads.
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

# Smallest step of the loads, as a fraction of the whole change.
_LEAST_STEP = 1 / 1024


def with_loads_of(scene: Scene, other: Scene) -> Scene | None:
    """Return a scene with the load values of another scene.

    Loads that the other scene lacks are 0 in the result, so that the equations of both scenes have
    one structure. Return None if other effects differ, or if the other scene has further loads.
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
    """Return the equilibrium under the loads of a system, on the branch of an equilibrium.

    Parameters
    ----------
    system : DiscreteRod
        The equations with the new loads.
    begin : Equilibrium
        The equilibrium under the old loads; tensions are constant.
    strains : (N stages, strains)
        The strains of `begin` at the stages of the system.

    Returns
    -------
    Equilibrium or None
        None if the branch ends because the arm snaps, folds or buckles, or if the scenes differ in
        more than the loads.
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
