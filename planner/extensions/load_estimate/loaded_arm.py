"""The equilibrium of an arm under an additional dead load on one cross-section, on one mesh."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.collocation_map import CollocationMap, predict_states
from octoplan.model.equilibrium.linearised import AnyEquilibrium, Equilibrium
from octoplan.model.equilibrium.newton import CHORD_RADIUS, STAGES, Start, newton, step_sizes
from octoplan.model.equilibrium.sensitivities import ParameterSensitivities
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod, system
from octoplan.model.rotations import POSE
from octoplan.model.scene import Scene
from octoplan.planner.extensions.load_estimate.readings import Readings

# Load factor: the loads of the scene act in full.
_FULL = 1.0
# Smallest step of a wrench that is followed, over the whole change.
_LEAST_STEP = 1 / 64


@dataclass(frozen=True, eq=False)
class LoadedShape:
    """An equilibrium under an additional wrench.

    Attributes
    ----------
    point : Equilibrium
    wrench : (6,)
        Force [N] and moment [N m] in the base frame.
    parameters : (n_p, 6)
        Derivatives of the parameters of the equations by the wrench.
    """

    point: Equilibrium
    wrench: Array
    parameters: Array

    @cached_property
    def states_by_wrench(self) -> Array:
        """The derivatives of the states (n_states, 6) by force and moment."""
        system = self.point.system
        none = np.zeros((system.length_p.size, 6)), np.zeros((system.layout.n_tendons, 6))
        return ParameterSensitivities(self.point, self.parameters, *none).states


class LoadedArm:
    """The equations with a wrench that adds to the loads of the scene.

    Force and moment are parameters of the equations, so that another wrench builds no other scene
    and no other mesh.

    Attributes
    ----------
    tensions : (n_tendons,)
        [N].
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        tensions: Array,
        at: float,
        readings: Readings,
        refinement: int,
        machine_code: bool,
    ) -> None:
        self.tensions = tensions
        nodes = tuple(np.unique([at, *readings.s]).tolist())
        self._equations = system(arm, scene, STAGES, refinement, nodes, True, machine_code)
        mesh = self._equations.mesh
        self._by_wrench = self._equations.wrench_parameters(mesh.node(at))
        self._poses = self._equations.layout.nodes[[mesh.node(s) for s in readings.s], :POSE]

    def without_wrench(self, settled: AnyEquilibrium) -> LoadedShape:
        """Return the shape without the wrench, from the same equilibrium on any mesh."""
        point = CollocationMap(self._equations).solve(self.tensions, settled)
        return LoadedShape(point, np.zeros(6), self._by_wrench)

    def near(self, shape: LoadedShape, wrench: Array) -> LoadedShape | None:
        """Return the shape under a wrench near a shape on any mesh, or None if Newton fails.

        Derivatives predict the states, and Newton's method corrects them.
        """
        before = shape.point
        on_same_mesh = self._has_mesh_of(before.system)
        is_same = np.array_equal(wrench, shape.wrench)
        if on_same_mesh and is_same and np.array_equal(self.tensions, before.tensions):
            return shape
        equations = copy(self._equations)
        equations.p = self._equations.p + self._by_wrench @ wrench
        states = predict_states(before, self.tensions)
        origin = None
        if not is_same:
            states = states + shape.states_by_wrench @ (wrench - shape.wrench)
        if on_same_mesh:
            _, (size,) = step_sizes(equations, (states - before.states)[None], before.states[None])
            origin = before if size < CHORD_RADIUS else None
        else:
            predicted = Equilibrium(before.system, before.system.x(self.tensions, _FULL, states))
            states = CollocationMap(equations).transfer_states(self.tensions[None], [predicted])[0]
        (point,) = newton(equations, [Start(self.tensions, _FULL, states, origin)])
        return None if point is None else LoadedShape(point, wrench, self._by_wrench)

    def followed(self, shape: LoadedShape, wrench: Array) -> LoadedShape | None:
        """Return the shape under a wrench on the branch of a shape, or None if the branch ends."""
        fraction = 0.0
        step = 1.0
        begin = shape.wrench
        while fraction < 1.0:
            step = min(step, 1.0 - fraction)
            end = 1.0 if step == 1.0 - fraction else fraction + step
            there = self.near(shape, begin + end * (wrench - begin) if end < 1.0 else wrench)
            if there is not None:
                shape = there
                fraction = end
                step *= 2
            elif step > _LEAST_STEP:
                step /= 2
            else:
                return None
        return shape

    def poses(self, shape: LoadedShape) -> Array:
        """Return the poses of the sensors (M, 7)."""
        return shape.point.states[self._poses]

    def poses_by_wrench(self, shape: LoadedShape) -> Array:
        """Return the derivatives of the poses of the sensors by force and moment (M, 7, 6)."""
        return shape.states_by_wrench[self._poses]

    def poses_by_tensions(self, shape: LoadedShape) -> Array:
        """Return the derivatives of the poses of the sensors by tensions (M, 7, n_tendons)."""
        return shape.point.by_tensions[self._poses]

    def _has_mesh_of(self, other: DiscreteRod) -> bool:
        """Return whether other equations have the same states at the same places."""
        same = other.layout is self._equations.layout
        return same and np.array_equal(other.mesh.s, self._equations.mesh.s)
