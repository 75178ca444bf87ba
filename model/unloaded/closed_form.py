"""The fast path: strains in closed form, poses by Magnus steps from the base.

Data flow: tensions -> tendon resultants at the steps' nodes (polynomials carried on from section to
section) -> strains (closed form) -> one relative pose per step (Magnus) -> poses at the nodes
(products from the base).
"""

from __future__ import annotations

from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.effects import ExactTendons, Extension, NeoHookean
from model.integrators.magnus import Magnus
from model.machine.buffered import Buffered, Mapped
from model.machine.compiled import kernel
from model.paths import Array
from model.rotations import compose
from model.scene import Scene
from model.stations import Counts, base_pose, stations
from model.unloaded.geometry import GeometryOnMesh, nodes_of
from model.unloaded.pulls import PullPolynomials
from model.unloaded.statics import ClosedStatics, closed_statics


@lru_cache(maxsize=24)
def strain_function(statics: ClosedStatics) -> ca.Function:
    """Return (pull, data) -> (tau, xi, k, q) at one cross-section; tau is 0."""
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    strain = statics.law.reported(statics.solve(pull, data))
    return ca.Function("strain", [pull, data], [ca.densify(strain)], {"cse": True})


def twist(strain: ca.SX) -> ca.SX:
    """Return (kappa, nu) per unit reference length from (tau, xi, k, q), eq. (1)."""
    stretch = 1 + strain[3]
    return ca.vertcat(stretch * strain[:3], stretch, 0, 0)


def pull_at(
    arm: Arm, statics: ClosedStatics, s: Array, active: Counts, T: ca.MX
) -> tuple[ca.MX, ca.DM]:
    """Return pull (n_pull, N) of tensions (n_tendons,), and data (n_data, N), at s (N,)."""
    at = stations(arm, s, active)
    maps = ca.sparsify(ca.DM(statics.pulls(arm, at).reshape(-1, arm.n_tendons)))
    return ca.reshape(maps @ T, -1, s.size), ca.DM(statics.data(at))


class SectionStrains:
    """The strains of cross-sections at s (N,) where loads are left out, by tensions."""

    def __init__(
        self, arm: Arm, scene: Scene, s: Array, active: Counts, machine_code: bool = False
    ) -> None:
        self.arm, self.scene, self.s, self.active = arm, unloaded(scene), s, active
        statics, at = closed_statics(self.scene, arm), stations(arm, s, active)
        self._maps, self._data = statics.pulls(arm, at), statics.data(at).T
        self._call = Mapped(kernel(strain_function(statics), machine_code))

    def of_many(self, tensions: Array) -> Array:
        """Return tau, xi, k, q (M, N, 4) under tensions (M, n_tendons); NaN where nothing does."""
        pulls = np.einsum("nij,mj->mni", self._maps, tensions)
        data = np.broadcast_to(self._data, (len(tensions), *self._data.shape))
        rows = (part.reshape(-1, part.shape[-1]) for part in (pulls, data))
        return self._call(*rows)[0].reshape(*pulls.shape[:2], -1)

    def __call__(self, tensions: Array) -> Array:
        """Return tau, xi, k, q (N, 4) under tensions (n_tendons,); NaN where nothing settles."""
        (found,) = self._call(self._maps @ tensions, self._data)
        lost, robust = np.isnan(found).any(axis=1), self.scene.robust()
        if lost.any() and robust != self.scene:
            again = SectionStrains(self.arm, robust, self.s[lost], self.active[lost])
            found[lost] = again(tensions)
        return found


def unloaded(scene: Scene) -> Scene:
    """Return the scene with what a section settles by itself, and nothing else."""
    kept = (Extension, ExactTendons, NeoHookean)
    return Scene(*(effect for effect in scene.effects if isinstance(effect, kept)))


@lru_cache(maxsize=24)
def step_function(statics: ClosedStatics, scheme: Magnus) -> ca.Function:
    """Return (pull (n_pull, m), data (n_data, m), h) -> relative pose of a step (7,), 1 + q (m,).

    Columns are the scheme's nodes in the step.
    """
    m, h = len(scheme.nodes), ca.SX.sym("h")
    pull, data = ca.SX.sym("pull", statics.n_pull, m), ca.SX.sym("data", statics.n_data, m)
    strains = [strain_function(statics)(pull[:, i], data[:, i]) for i in range(m)]
    step = scheme.step([twist(strain) for strain in strains], h)
    stretch = ca.vertcat(*(1 + strain[3] for strain in strains))
    return ca.Function("step", [pull, data, h], [step, stretch], {"cse": True})


@lru_cache(maxsize=24)
def march_function(statics: ClosedStatics, scheme: Magnus) -> ca.Function:
    """Return (pose, pull, data, h) -> pose across a step, 1 + q; see step_function."""
    step = step_function(statics, scheme)
    g, *given = ca.SX.sym("g", 7), *step.sx_in()
    relative, stretch = step(*given)
    return ca.Function("march", [g, *given], [compose(g, relative), stretch], {"cse": True})


@lru_cache(maxsize=48)
def _calls(
    statics: ClosedStatics, scheme: Magnus, steps: int, ends: int, machine_code: bool
) -> tuple[Buffered, Buffered]:
    """Return march_function over so many steps and strain_function at the ends of segments.

    They depend on an arm's structure alone, so that one with other numbers builds nothing.
    """
    march = kernel(march_function(statics, scheme), machine_code).mapaccum(steps)
    return Buffered(march), Buffered(kernel(strain_function(statics), machine_code).map(ends))


class ClosedForm:
    """The forward map of an unloaded scene with closed-form strains, on one mesh.

    Attributes
    ----------
    function : casadi.Function
        tensions (n_tendons,) -> poses at the mesh's nodes (7, S + 1), and 1 + q at the arc lengths
        `stretch_at` (1, K), the scheme's nodes in the steps and both ends of each segment, which
        `stretch_active` sections cross.
    maps, data
        Maps (K, n_pull, n_tendons) from tensions to pull there, and data (K, n_data).
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        places: GeometryOnMesh,
        scheme: Magnus,
        machine_code: bool = False,
        refinement: int = 0,
    ) -> None:
        self.arm, self.scene, self.scheme, self.mesh = arm, scene, scheme, places.mesh
        self.name, self.refinement, self.machine_code = scheme.name, refinement, machine_code
        self.stretch_at, self.stretch_active = places.at, places.active
        self.maps, self.data = places.maps, places.data(arm)
        self._base, self._h, steps = places.base, places.h, places.mesh.steps
        ends = places.at.size - steps * len(scheme.nodes)
        self._calls = _calls(closed_statics(scene, arm), scheme, steps, ends, machine_code)

    @cached_property
    def function(self) -> ca.Function:
        """The map as a function that CasADi differentiates; see the class."""
        arm, mesh, n = self.arm, self.mesh, self.mesh.steps * len(self.scheme.nodes)
        statics = closed_statics(self.scene, arm)
        T = ca.MX.sym("T", arm.n_tendons)
        s, active = self.stretch_at, self.stretch_active
        inner, ends = (
            pull_and_data(arm, statics, s[i], active[i], T) for i in (np.s_[:n], np.s_[n:])
        )
        march = kernel(march_function(statics, self.scheme), self.machine_code)
        poses, stretch = march.mapaccum(mesh.steps)(
            base_pose(arm), *inner, ca.DM(np.diff(mesh.s)).T
        )
        at = kernel(strain_function(statics), self.machine_code).map(s.size - n)
        everywhere = ca.horzcat(ca.reshape(stretch, 1, -1), 1 + at(*ends)[3, :])
        nodes = ca.horzcat(self._base, poses)
        return ca.Function("closed_form", [T], [ca.densify(nodes), ca.densify(everywhere)])

    def run(self, tensions: Array) -> tuple[Array, Array]:
        """See March.run: poses (S + 1, 7) and 1 + q (K,)."""
        march, at_ends = self._calls
        n, pull = self.mesh.steps * len(self.scheme.nodes), self.maps @ tensions
        given = pull[:n].ravel(), self.data[:n].ravel()
        beyond, inner = march(self._base, *given, self._h)
        (strains,) = at_ends(pull[n:].ravel(), self.data[n:].ravel())
        poses, stretch = np.vstack([self._base, beyond]), np.append(inner, 1 + strains[:, 3])
        lost = np.isnan(poses[:, 4])
        if lost.any():  # without extension a section that does not settle shows in the poses only
            stretch[self.stretch_at >= self.mesh.s[np.argmax(lost) - 1]] = np.nan
        return poses, stretch

    def dense(self, tensions: Array, poses: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at arc lengths s, a step from the nodes below."""
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.steps - 1)
        active, left, m = self.mesh.active[step], self.mesh.s[step], len(self.scheme.nodes)
        march, strain = _dense(closed_statics(self.scene, self.arm), self.scheme)
        inside = self._given(nodes_of(self.scheme, left, s), np.repeat(active, m), tensions)
        pull, data = (values.reshape(s.size, -1) for values in inside)
        pose, _ = march(poses[step], pull, data, s - left)
        (strains,) = strain(*self._given(s, active, tensions))
        at_node = (s == self.mesh.s[step + 1])[:, None]
        return np.where(at_node, poses[step + 1], pose), strains

    def _given(self, s: Array, active: Counts, tensions: Array) -> tuple[Array, Array]:
        """Return pull (N, n_pull) and data (N, n_data) at s (N,)."""
        statics, at = closed_statics(self.scene, self.arm), stations(self.arm, s, active)
        return np.asarray(statics.pulls(self.arm, at) @ tensions), statics.data(at).T


@lru_cache(maxsize=24)
def _dense(statics: ClosedStatics, scheme: Magnus) -> tuple[Mapped, Mapped]:
    """Return march_function and strain_function for many places at once."""
    return Mapped(march_function(statics, scheme)), Mapped(strain_function(statics))


def pull_and_data(
    arm: Arm, statics: ClosedStatics, s: Array, active: Counts, T: ca.MX
) -> tuple[ca.MX, ca.DM]:
    """Return pull (n_pull, N) and data (n_data, N) at arc lengths s (N,), base to tip."""
    polynomials = PullPolynomials.of(arm, statics)
    if polynomials is None:
        return pull_at(arm, statics, s, active, T)
    return polynomials.pull(T, s, active), ca.DM(statics.data(stations(arm, s, active)))
