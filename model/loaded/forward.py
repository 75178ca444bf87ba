"""The forward map of a loaded scene, on one mesh: tensions to states by multiple shooting."""

from __future__ import annotations

import casadi as ca
import numpy as np

from model.effects import ExactTendons, Extension, NeoHookean
from model.integrators.magnus import MAGNUS6
from model.loaded.continuation import LoadedEquilibrium
from model.loaded.functions import load_step, state_reader, strain_reader
from model.loaded.segments import LoadSegments
from model.paths import Array
from model.scene import Scene
from model.unloaded.closed_form import ClosedForm, strains_at
from model.unloaded.shooting import Shooting
from model.unloaded.stretch import check_sections


def unloaded(scene: Scene) -> Scene:
    """Return the scene with what a section settles by itself, and nothing else."""
    kept = (Extension, ExactTendons, NeoHookean)
    return Scene(*(effect for effect in scene.effects if isinstance(effect, kept)))


class Loaded:
    """See ForwardMap; its states are those of model.loaded.state."""

    def __init__(self, system: LoadSegments) -> None:
        self.system, self.mesh, self.order = system, system.mesh, system.scheme.order
        self.equilibrium = LoadedEquilibrium(system)
        self._first = [self.mesh.node(segment.nodes[0]) for segment in system.segments]
        self.free = ClosedForm(system.arm, unloaded(system.scene), self.mesh, MAGNUS6)
        self._unloaded = self._starts_unloaded()
        self.paths = self._paths()
        places = [segment.nodes for segment in system.segments]
        self.stretch_at = np.concatenate(places)

    def _paths(self) -> ca.Function:
        """Return (X, p) -> states at the nodes from base to tip, 1 + q at `stretch_at`."""
        shooting = Shooting(self.system)
        X = ca.MX.sym("X", shooting.n_x, shooting.n_segments)
        p = ca.MX.sym("p", self.system.n_p)
        paths = shooting.trajectories(X / ca.DM(self.system.scale), p)
        columns = ca.horzcat(*(path[:, :-1] for path in paths), paths[-1][:, -1])
        pairs = zip(self.system.segments, paths, strict=True)
        stretch = ca.horzcat(*(segment.stretch(path, p) for segment, path in pairs))
        return ca.Function("paths", [X, p], [columns[:, ::-1], stretch])

    def run(self, tensions: Array, near: Array | None = None) -> tuple[Array, Array]:
        """See ForwardMap.run; raises SnapError."""
        X = None if near is None else self.equilibrium.near(near, tensions)
        if X is None:
            X = self.equilibrium.bring_on(self.without_loads(tensions), tensions)
        states, stretch = self.paths(X, self.system.p(tensions))
        return np.array(states).T, np.array(stretch).ravel()

    def starts(self, states: Array) -> Array:
        """See ForwardMap.starts."""
        return states[self._first].T

    def without_loads(self, tensions: Array) -> Array:
        """Return the states at the segments' starts where the share of the loads is 0.

        Raises UnsettledSectionError.
        """
        states, stretch = self._unloaded(tensions)
        check_sections(self.free, np.array(stretch).ravel())
        return np.array(states)

    def _starts_unloaded(self) -> ca.Function:
        """Return T -> the states at the segments' starts (n_x, segments) without loads, 1 + q.

        Strains are those on the start's side of the segment.
        """
        T, e, n = ca.MX.sym("T", self.system.arm.n_tendons), self.system.equations, len(self._first)
        s, step = self.mesh.s[self._first], np.array(self._first) - 1
        strains = strains_at(self.free.arm, self.free.scene, s, self.mesh.active[step], T)
        poses, stretch = self.free.function(T)
        rows = [
            poses[:, self._first],
            state_reader(e).map(n)(strains),
            ca.MX.zeros(e.n_force, n),
            ca.repmat(ca.reshape(T[: e.n_tension], e.n_tension, 1), 1, n),
            ca.MX.zeros(e.n_length, n),
        ]
        return ca.Function("unloaded", [T], [ca.densify(ca.vertcat(*rows)), stretch])

    def dense(self, tensions: Array, states: Array, s: Array) -> tuple[Array, Array]:
        """See ForwardMap.dense: a step from the nodes above."""
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.steps - 1)
        poses, strains = np.zeros((s.size, 7)), np.zeros((s.size, 6))
        for segment in self.system.segments:
            below = self.mesh.s[step]
            inside = (below >= segment.nodes[-1]) & (below < segment.nodes[0])
            if inside.any():
                found = self._dense(tensions, states, s[inside], step[inside], segment.nodes[0])
                poses[inside], strains[inside] = found
        return poses, strains

    def _dense(
        self, tensions: Array, states: Array, s: Array, step: Array, beyond: float
    ) -> tuple[Array, Array]:
        p = ca.MX.sym("p", self.system.n_p)
        active, start = self.mesh.active[step], self.mesh.s[step + 1]
        data = self.system.step_data(start, s - start, active, beyond, p)
        across = load_step(self.system.equations, self.system.scheme).map(s.size)
        x = across(ca.DM(states[step + 1].T), *data, ca.DM(s - start).T)
        here = self.system.sections(s, active, beyond, p).still
        full = strain_reader(self.system.equations).map(s.size)(x, *here)
        values = ca.Function("dense", [p], [x[:7, :], full])(self.system.p(tensions))
        return np.array(values[0]).T, np.array(values[1]).T
