"""How a settled shape answers to a force and moment on its midline, and to its tendons.

By the implicit function theorem through the shooting constraints, with exact derivatives; see
model.loaded.lifting.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.forward import SCHEMES
from model.integrators.runge_kutta import RungeKutta
from model.loaded.forward import Loaded
from model.loaded.lifting import Lifting
from model.loaded.loads import places
from model.loaded.segments import LoadSegments
from model.mesh import graded
from model.paths import Array
from model.rotations import small_turns
from model.scene import Scene
from model.shape import Shape


@dataclass(frozen=True, eq=False)
class Answers:
    """Slopes of a settled shape.

    Attributes
    ----------
    pose_wrench : (6, 6)
        Displacement [m] and turn [rad] per force [N] and moment [N m], all in the base frame, at
        the probe.
    pose_tension : (6, n_tendons)
        The same per newton in each tendon at its motor.
    length_wrench : (n_tendons, 6), length_tension : (n_tendons, n_tendons)
        Lengths of the tendons per force and moment, and per newton [m]; empty where lengths were
        not asked for.
    lengths : (n_tendons,)
        Lengths of the tendons [m]; empty as well.
    stable : bool
        Whether the equilibrium has kept its stability, tensions held.
    """

    pose_wrench: Array
    pose_tension: Array
    length_wrench: Array
    length_tension: Array
    lengths: Array
    stable: bool


class Sensitivity:
    """The slopes of one scene with its probe, on one mesh.

    Attributes
    ----------
    loaded : Loaded
        What settles the shape.
    """

    def __init__(self, loaded: Loaded) -> None:
        self.loaded, system = loaded, loaded.system
        n_T = system.arm.n_tendons
        directions = ca.DM(system.n_p, 6 + n_T)
        directions[-6:, :6] = ca.DM.eye(6)
        directions[:n_T, 6:] = ca.DM.eye(n_T)
        X = ca.MX.sym("X", system.scale.size, len(system.segments))
        p = ca.MX.sym("p", system.n_p)
        lifting = Lifting(system, directions)
        moves, base = lifting.solve(lifting.sweep(X, p), p)
        at = [system.mesh.node(segment.nodes[0]) for segment in system.segments]
        assert system.probe is not None
        i = at.index(system.mesh.node(system.probe))
        shift = moves[i][4:7, :] - base[4:7, :]
        pose = ca.vertcat(shift, small_turns()(X[:4, i]) @ moves[i][:4, :])
        lengths = base[system.equations.n_x - system.equations.n_length :, :]
        self.function = ca.Function("answers", [X, p], [pose, lengths])

    def starts_at(self, shape: Shape) -> Array | None:
        """Return the states at the segments' starts of a shape settled with the same loads.

        None where it has no state to give there, being settled without shooting.
        """
        system = self.loaded.system
        nodes = [segment.nodes[0] for segment in system.segments]
        rows = [int(np.argmin(np.abs(shape.s - s))) for s in nodes]
        found = shape.states[rows]
        size = system.equations.n_x - system.equations.n_length
        if found.shape[1] != size or np.abs(shape.s[rows] - nodes).max() > 1e-9 * system.arm.length:
            return None
        return np.hstack([found, np.zeros((len(rows), system.equations.n_length))]).T

    def at(self, tensions: Array, states: Array) -> Answers:
        """Return the slopes at the settled states (S + 1, n_x) under tensions (n_tendons,)."""
        X, p = self.loaded.starts(states), self.loaded.system.p(tensions)
        pose, lengths = (np.array(value) for value in self.function(X, p))
        stable = not self.loaded.equilibrium.jacobi.lost(X, p)
        settled = states[0, states.shape[1] - lengths.shape[0] :]
        return Answers(
            pose[:, :6], pose[:, 6:], lengths[:, :6], lengths[:, 6:], settled.copy(), stable
        )


@lru_cache(maxsize=64)
def sensitivity(
    arm: Arm, scene: Scene, scheme: str, refinement: int, at: float, lengths: bool
) -> Sensitivity:
    """Return the slopes at arc length `at`, built once."""
    method = SCHEMES[scheme]
    assert isinstance(method, RungeKutta)
    mesh = graded(arm, refinement, (at, *places(arm, scene)))
    return Sensitivity(Loaded(LoadSegments(arm, scene, mesh, method, at, lengths)))
