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
from model.cross_section.law import CrossSection, size
from model.cross_section.reported import reported
from model.integrators.magnus import Magnus
from model.machine.buffered import Buffered, Mapped
from model.machine.compiled import kernel
from model.paths import Array
from model.rotations import compose
from model.scene import Scene
from model.stations import Counts, base_pose, stations
from model.unloaded.geometry import GeometryOnMesh, nodes_of
from model.unloaded.pulls import PullPolynomials
from model.unloaded.section_solver import settled, solver
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
def _march(law: CrossSection, scheme: Magnus, steps: int, machine_code: bool) -> Buffered:
    """Return (pose, strains at the nodes of each of so many steps, h) -> poses after them.

    It depends on an arm's structure alone, so that one with other numbers builds nothing.
    """
    return Buffered(kernel(_marched(law, scheme), machine_code).mapaccum(steps))


@lru_cache(maxsize=24)
def _marched(law: CrossSection, scheme: Magnus) -> ca.Function:
    """Return (pose, strains at the nodes of a step, h) -> pose across it."""
    m, n = len(scheme.nodes), size(law)
    g, v, h = ca.SX.sym("g", 7), ca.SX.sym("v", n * m), ca.SX.sym("h")
    twists = [ca.vertcat(*law.twist(one)) for one in ca.vertsplit(v, n)]
    return ca.Function("marched", [g, v, h], [compose(g, scheme.step(twists, h))], {"cse": True})


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
        self._base, self._h, self._statics = places.base, places.h, closed_statics(scene, arm)
        law = self._statics.law
        self._solver = solver(self._statics, len(self.data), machine_code)
        self._march = _march(law, scheme, places.mesh.steps, machine_code)

    @property
    def law(self) -> CrossSection:
        """The law of the cross-sections, whose strains these are."""
        return self._statics.law

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
        v = self.strains(tensions)
        return self.poses(v), self._along(v)

    def strains(self, tensions: Array) -> Array:
        """Return the strains (K, n) of the law at `stretch_at`; NaN where none balance."""
        return self._solver(self.maps @ tensions, self.data)

    def strains_of_many(self, tensions: Array) -> Array:
        """Return `strains` (M, K, n) under tensions (M, n_tendons)."""
        pulls = np.einsum("nij,mj->mni", self.maps, tensions)
        data = np.tile(self.data, (len(tensions), 1))
        found = settled(self._statics, pulls.reshape(len(data), -1), data, self.machine_code)
        return found.reshape(*pulls.shape[:2], -1)

    def poses(self, v: Array) -> Array:
        """Return the poses at the nodes (S + 1, 7) of strains at `stretch_at` (K, n)."""
        inner = v[: self.mesh.steps * len(self.scheme.nodes)]
        found = np.empty((self.mesh.steps + 1, 7))
        found[0] = self._base
        (found[1:],) = self._march(self._base, inner.ravel(), self._h)
        return found

    def _along(self, v: Array) -> Array:
        """Return 1 + q (K,) of strains; NaN where these are none."""
        law = self._statics.law
        if not law.extension:
            return 1 + 0 * v[:, 0]
        return 1 + (v[:, 2] - law.along_at_rest)

    def dense(self, tensions: Array, poses: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at arc lengths s, a step from the nodes below."""
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.steps - 1)
        active, left, m = self.mesh.active[step], self.mesh.s[step], len(self.scheme.nodes)
        law = self._statics.law
        inside = nodes_of(self.scheme, left, s)
        v = self._settled(inside, np.repeat(active, m), tensions).reshape(s.size, -1)
        (pose,) = _dense(law, self.scheme)(poses[step], v, s - left)
        strains = reported(law, self._settled(s, active, tensions))
        at_node = (s == self.mesh.s[step + 1])[:, None]
        return np.where(at_node, poses[step + 1], pose), strains

    def _settled(self, s: Array, active: Counts, tensions: Array) -> Array:
        """Return the strains (N, n) at s (N,)."""
        at = stations(self.arm, s, active)
        pull = np.asarray(self._statics.pulls(self.arm, at) @ tensions)
        return settled(self._statics, pull, self._statics.data(at).T)


@lru_cache(maxsize=24)
def _dense(law: CrossSection, scheme: Magnus) -> Mapped:
    """Return the march across a step for many places at once."""
    return Mapped(_marched(law, scheme))


def pull_and_data(
    arm: Arm, statics: ClosedStatics, s: Array, active: Counts, T: ca.MX
) -> tuple[ca.MX, ca.DM]:
    """Return pull (n_pull, N) and data (n_data, N) at arc lengths s (N,), base to tip."""
    polynomials = PullPolynomials.of(arm, statics)
    if polynomials is None:
        return pull_at(arm, statics, s, active, T)
    return polynomials.pull(T, s, active), ca.DM(statics.data(stations(arm, s, active)))
