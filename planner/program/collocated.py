"""The mechanics inside a program: an arm's equations on a mesh, their numbers and solution."""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from model.arm import Arm
from model.equilibrium.forward import STAGES, Collocation, Known
from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import least_eigenvalue, stability, stands
from model.errors import OctoplanError, SnapError, UnsettledSectionError
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.winches import least_compliance
from planner.program.condensed import Condensed
from planner.program.program import program
from planner.program.statement import Statement
from planner.program.states import States, Stations
from planner.program.terms import compliance_requests
from planner.targets.base import Target

# Strains of an arm from which on the least eigenvalue is sooner found by iteration.
_DENSE = 120
# Tips of one shape are no farther apart, over the arm's length.
_SAME = 1e-3


class Collocated:
    """The mechanics of all scenes but those as printed.

    Attributes
    ----------
    program : Program
        The structure.
    forward : Collocation
        The same equations without targets, which settle the states.
    states : States
        Their numbers and scales.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        targets: tuple[Target, ...],
        statement: Statement,
        stations: tuple[float, ...],
        machine_code: bool,
    ) -> None:
        requests = compliance_requests(targets)
        loaded = is_loaded(scene) or bool(requests)
        mesh = (statement.stages, statement.refinement, stations)
        self.forward = Collocation(arm, scene, *mesh, loaded, machine_code)
        at = self.forward.system
        self.states = States(at, requests, least_compliance(arm), statement.modes, statement.wound)
        self.program = program(arm, targets, statement, at.of, Stations.of(at, stations))

    def numbers(self, target: Array) -> Array:
        """Return the parameters of the mechanics for the targets' numbers."""
        of = self.program.objective
        directions = [np.array(D) for D in of.directions.call([target[: of.n_own]])]
        states = self.states
        scales = (states.scale, states.row_scale)
        return np.concatenate([np.array([states.force]), states.numbers(directions), *scales])

    def unknowns(self, a: Array, tensions: Array, p: Array) -> Array:
        """Return all unknowns for tensions: states that settle them, what inequalities lack.

        Where the arm does not bear its loads, or comes to them by many steps only, the states are
        those without loads.
        """
        try:
            states = self.forward.found_soon(tensions).states
        except (SnapError, UnsettledSectionError):
            states = self.forward.without_loads(tensions)
        return self.condensed.whole(a, states, p)

    def values(self, x: Array, p: Array) -> Array:
        """Return the constraints at unknowns x."""
        return np.concatenate([self.program.values(x, p)[1][0], self.program.equilibrium(x, p)])

    def stability(self, x: Array, tensions: Array, near: Known | None = None) -> float:
        """Return the stability of the shape at unknowns x, infinite without loads.

        Of unknowns without states, of the shape that the arm settles in.
        """
        system = self.forward.system
        if not is_loaded(system.scene):
            return np.inf
        try:
            states = self.states_of(x, tensions, near)
            here = Linearised(system, system.x(tensions, 1.0, states))
            fine = system.of.stages.size > _DENSE and stands(here)
            return least_eigenvalue(here) if fine else stability(here)
        except OctoplanError:
            return -np.inf

    def is_from_rest(self, x: Array, tensions: Array) -> bool:
        """Return whether the shape in unknowns x is that which the unloaded arm comes to."""
        tip = self.forward.system.of.nodes[-1, 4:7]
        try:
            settled = self.forward.from_rest(tensions).states
        except OctoplanError:
            return False
        apart = np.linalg.norm((settled - self.states_of(x, tensions))[tip])
        return bool(apart <= _SAME * self.forward.system.arm.length)

    def moved_by_loads(self, tensions: Array) -> float:
        """Return how far the loads move the tip [m], infinite where they are too heavy."""
        return _moved(self.forward, tensions)

    def states_of(self, x: Array, tensions: Array, near: Known | None = None) -> Array:
        """Return the states (n_states,) in unknowns x, those settled where x has none."""
        if x.size == self.program.n_free:
            return self.forward.found(tensions, near).states
        of = self.forward.system.of
        return np.asarray(x[self.program.blocks.states] * self.states.scale[1 : 1 + of.n_states])

    @cached_property
    def condensed(self) -> Condensed:
        """The same problem with the states eliminated."""
        return Condensed(self.program, self.forward, self.states)


@lru_cache(maxsize=32)
def moved_at_rest(arm: Arm, scene: Scene, tensions: tuple[float, ...], machine_code: bool) -> float:
    """Return how far loads move the tip of an arm on a coarse mesh [m]; remembered."""
    forward = Collocation(arm, scene, STAGES, 1, (), True, machine_code)
    return _moved(forward, np.array(tensions))


def _moved(forward: Collocation, tensions: Array) -> float:
    tip = forward.system.of.nodes[-1, 4:7]
    try:
        before = forward.without_loads(tensions)
        after = forward.found_soon(tensions)
    except OctoplanError:
        return np.inf
    return float(np.linalg.norm(after.states[tip] - before[tip]))
