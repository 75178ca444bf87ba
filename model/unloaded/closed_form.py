"""The fast path: strains in closed form, poses by Magnus steps from the base.

Data flow: tensions -> tendon resultants at the steps' nodes -> strains (closed form) -> poses at
the nodes, by one Magnus step after the other from the base on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.cross_section import cross_section_of
from model.cross_section.law import CrossSection, reported, size
from model.cross_section.sections import Sections
from model.integrators import Magnus
from model.machine.buffered import Buffered, Mapped
from model.machine.columns import Columns
from model.machine.compiled import kernel
from model.mesh import Mesh, graded, roughly
from model.paths import Array
from model.rotations import compose
from model.scene import Scene
from model.stations import Counts, base_pose, stations
from model.unloaded.sections import StrainsByTensions
from model.unloaded.statics import (
    ClosedStatics,
    EnergyStatics,
    PaperStatics,
    balance_function,
)

# E A, E J and G I come first among the data of a cross-section.
_BODY = 3


class Geometry:
    """An arm whatever it is made of: equal to another of the same tendons and taper.

    Attributes
    ----------
    arm : Arm
    taper : Path
        What its meshes are graded for.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm, self.taper = arm, roughly(arm.radius)
        body = (arm.length, self.taper, arm.sections, arm.rest_curvature)
        self._key = (*body, arm.base_frame, arm.base_position)

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Geometry) and self._key == other._key


@dataclass(frozen=True, eq=False)
class GeometryOnMesh:
    """The places of a closed form on a mesh, and the numbers of its geometry there.

    Attributes
    ----------
    at : (K,)
        Arc lengths: a scheme's nodes in the steps, then both ends of each segment [m].
    active : (K,)
        How many sections' tendons cross there.
    maps : (K, n_pull, n_tendons)
        From tensions to pull.
    others : (K, n_data - 3)
        What of the data is no stiffness of the body.
    base, h : (7,), (S,)
        Pose of the base, lengths of the steps [m].
    """

    mesh: Mesh
    at: Array
    active: Counts
    maps: Array
    others: Array
    base: Array
    h: Array

    def data(self, arm: Arm) -> Array:
        """Return the data (K, n_data) of an arm of this geometry."""
        E, G, R = arm.material.E, arm.material.G, arm.radius.evaluate(self.at, arm.length)[0]
        area = np.pi * R**2
        J = area * R**2 / 4
        return np.hstack([np.array([E * area, E * J, 2 * G * J]).T, self.others])


@lru_cache(maxsize=64)
def geometry_on_mesh(
    geometry: Geometry,
    statics: ClosedStatics,
    scheme: Magnus,
    refinement: int,
    at: tuple[float, ...],
) -> GeometryOnMesh:
    """Return the places on a mesh of a refinement that has the arc lengths `at` as nodes."""
    arm, m = geometry.arm, len(scheme.nodes)
    mesh = graded(arm, refinement, at, taper=geometry.taper)
    ends, at_ends = mesh.segment_ends()
    s = np.concatenate([nodes_of(scheme, mesh.s[:-1], mesh.s[1:]), ends])
    active = np.concatenate([np.repeat(mesh.active, m), at_ends])
    there = stations(arm, s, active)
    maps, others = statics.pulls(arm, there), statics.data(there)[_BODY:].T
    return GeometryOnMesh(mesh, s, active, maps, others, base_pose(arm), np.diff(mesh.s))


def nodes_of(scheme: Magnus, left: Array, right: Array) -> Array:
    """Return the arc lengths (m N,) of a scheme's nodes in N steps."""
    return np.ravel(left[:, None] + (right - left)[:, None] * np.array(scheme.nodes))


# Arms at a time, interpreted and by machine code: their numbers stay in the processor's cache.
_ARMS = 2048, 512
# So few steps are one list of operations, which CasADi runs sooner than a function time and again.
_WRITTEN_OUT = 64


class _Steps:
    """(pose, strains at the nodes of a step, h) -> pose across it, of a structure, any numbers."""

    def __init__(self, statics: ClosedStatics, scheme: Magnus, machine_code: bool) -> None:
        self._statics, self._scheme, self._machine_code = statics, scheme, machine_code
        g, v, h = self._symbols()
        step = ca.Function("marched", [g, ca.vec(v), h], [self._after(g, v, h)], {"cse": True})
        self.step, self._along = kernel(step, machine_code), dict[int, Buffered]()
        self.some = Mapped(self.step)

    @cached_property
    def many(self) -> Columns:
        """The same of sets in columns, which tells the least 1 + q at the nodes besides.

        Pull and data of the nodes stand for strains that are an expression of these.
        """
        (g, v, h), statics = self._symbols(), self._statics
        arguments = [ca.vec(v)]
        if isinstance(statics, PaperStatics):
            m = v.shape[1]
            pull, data = ca.SX.sym("pull", statics.n_pull, m), ca.SX.sym("data", statics.n_data, m)
            pairs = zip(ca.horzsplit(pull), ca.horzsplit(data), strict=True)
            v = ca.horzcat(*(statics.solve(*pair) for pair in pairs))
            arguments = [ca.vec(pull), ca.vec(data)]
        stretch = [1 + statics.law.reported(each)[3] for each in ca.horzsplit(v)]
        results = [self._after(g, v, h), ca.mmin(ca.vertcat(*stretch))]
        step = ca.Function("marched_by_many", [g, *arguments, h], results, {"cse": True})
        return Columns(step, self._machine_code)

    def along(self, count: int) -> Buffered:
        """Return so many steps one after another: the poses at all nodes."""
        if count not in self._along:
            march = self.step.mapaccum(count)
            g, *value = march.mx_in()
            nodes = ca.Function("marched", [g, *value], [ca.horzcat(g, march(g, *value))])
            few = count <= _WRITTEN_OUT and self.step.is_a("SXFunction")
            self._along[count] = Buffered(nodes.expand() if few else nodes)
        return self._along[count]

    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        n, m = size(self._statics.law), len(self._scheme.nodes)
        return ca.SX.sym("g", 7), ca.SX.sym("v", n, m), ca.SX.sym("h")

    def _after(self, g: ca.SX, v: ca.SX, h: ca.SX) -> ca.SX:
        """Return the pose after a step from g."""
        twists = [ca.vertcat(*self._statics.law.twist(one)) for one in ca.horzsplit(v)]
        return compose(g, self._scheme.step(twists, h))


@lru_cache(maxsize=32)
def _steps(statics: ClosedStatics, scheme: Magnus, machine_code: bool) -> _Steps:
    """Return the steps of a structure, made once."""
    return _Steps(statics, scheme, machine_code)


class ClosedForm:
    """The forward map of an unloaded scene with closed-form strains, on one mesh.

    Attributes
    ----------
    function : casadi.Function
        tensions (n_tendons,) -> poses at the mesh's nodes (7, S + 1), and 1 + q at the arc lengths
        `stretch_at` (1, K), the scheme's nodes in the steps and both ends of each segment, which
        `stretch_active` sections cross.
    strains : StrainsByTensions
        The strains there.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        statics: ClosedStatics,
        places: GeometryOnMesh,
        scheme: Magnus,
        machine_code: bool = False,
        refinement: int = 0,
    ) -> None:
        self.arm, self.scene, self.scheme, self.mesh = arm, scene, scheme, places.mesh
        self.name, self.refinement, self.machine_code = scheme.name, refinement, machine_code
        self.stretch_at, self.stretch_active = places.at, places.active
        data = places.data(arm)
        self.strains = StrainsByTensions(statics, places.maps, data, machine_code)
        self._radius = 2 * np.sqrt(data[:, 1] / data[:, 0])
        self._base, self._h, self._statics = places.base, places.h, statics
        self._steps = _steps(statics, scheme, machine_code)
        self._march = self._steps.along(places.mesh.steps)

    @property
    def law(self) -> CrossSection:
        """The law of the cross-sections, whose strains these are."""
        return self._statics.law

    @cached_property
    def sections(self) -> Sections:
        """The cross-sections at the nodes of the steps, which wrenches may twist."""
        law, values = (
            cross_section_of(self.scene, self.arm.is_curved),
            slice(self.mesh.steps * len(self.scheme.nodes)),
        )
        where = self.stretch_at[values], self.stretch_active[values]
        return Sections(self.arm, self.scene, law, *where, self.machine_code)

    @cached_property
    def function(self) -> ca.Function:
        """The map as a function that CasADi differentiates; see the class."""
        law, T = self.law, ca.MX.sym("T", self.arm.n_tendons)
        maps = self.strains.maps
        K, n_pull, n = maps.shape
        pull = ca.reshape(ca.sparsify(ca.DM(maps.reshape(-1, n))) @ T, n_pull, K)
        balance = kernel(balance_function(self._statics), self.machine_code)
        v = balance.map(K)(pull, ca.DM(self.strains.data.T))
        inner = ca.reshape(v[:, : self.mesh.steps * len(self.scheme.nodes)], -1, self.mesh.steps)
        march = self._steps.step.mapaccum(self.mesh.steps)
        nodes = ca.horzcat(self._base, march(self._base, inner, ca.DM(self._h).T))
        along = v[2, :] - law.along_at_rest if law.extension else 0 * v[0, :]
        return ca.Function("closed_form", [T], [ca.densify(nodes), ca.densify(1 + along)])

    def run(self, tensions: Array) -> tuple[Array, Array, Array]:
        """See March.run: poses (S + 1, 7), 1 + q (K,) and strains of the law."""
        v = self.strains(tensions)
        return self.poses(v), self._along(v), v

    def bend(self, strains: Array) -> float:
        """See March.bend, by the radius that E J and E A are of."""
        bend = np.hypot(strains[:, 0], strains[:, 1]) * self._radius
        if isinstance(self._statics, EnergyStatics):  # whose curvatures are per reference length
            bend /= self._along(strains)
        return float(bend.max())

    def many(self, tensions: Array, nodes: Sequence[int]) -> tuple[Array, Array]:
        """See March.many: so many arms at a time that their numbers stay at hand."""
        some = _ARMS[self.machine_code]
        parts = [self._many(tensions[i : i + some], nodes) for i in range(0, len(tensions), some)]
        poses, least = zip(*parts, strict=True) if parts else ((), ())
        whole = np.concatenate([np.zeros((0, len(nodes), 7)), *poses])
        return whole, np.concatenate([np.zeros(0), *least])

    def _many(self, tensions: Array, nodes: Sequence[int]) -> tuple[Array, Array]:
        M, S, K = len(tensions), self.mesh.steps, self.mesh.steps * len(self.scheme.nodes)
        if isinstance(self._statics, PaperStatics):
            pull = self.strains.maps[:K].reshape(-1, tensions.shape[1]) @ tensions.T
            arguments = [pull, self.strains.data[:K].reshape(-1, 1)]
        else:
            parts = [slice(k, k + K // S) for k in range(0, K, K // S)]
            strains = [self.strains.of_many(tensions, part).reshape(M, -1).T for part in parts]
            arguments = [np.concatenate(strains)]
        base = np.tile(self._base[:, None], M)
        poses, stretch = self._steps.many(base, *arguments, self._h[:, None], steps=S)
        poses = np.concatenate([base[None], poses.reshape(S, 7, M)])
        ends = self._along(self.strains.of_many(tensions, slice(K, None)))
        least = np.minimum(stretch.min(axis=0), ends.min(axis=1))
        return poses[nodes].transpose(2, 0, 1), least

    def poses(self, v: Array) -> Array:
        """Return the poses at the nodes (S + 1, 7) of strains at `stretch_at` (K, n)."""
        inner = v[: self.mesh.steps * len(self.scheme.nodes)]
        return self._march(self._base, inner.ravel(), self._h)[0]

    def _along(self, v: Array) -> Array:
        """Return 1 + q (..., K) of strains (..., K, n); NaN where these are none."""
        law = self._statics.law
        if not law.extension:
            return 1 + 0 * v[..., 0]
        return np.asarray(v[..., 2] + (1.0 - law.along_at_rest))

    def dense(self, tensions: Array, poses: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at arc lengths s, a step from the nodes below."""
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.steps - 1)
        active, left, m = self.mesh.active[step], self.mesh.s[step], len(self.scheme.nodes)
        law = self._statics.law
        inside = nodes_of(self.scheme, left, s)
        nodes = StrainsByTensions.at(self.arm, self._statics, inside, np.repeat(active, m))
        (pose,) = self._steps.some(poses[step], nodes(tensions).reshape(s.size, -1), s - left)
        at_s = StrainsByTensions.at(self.arm, self._statics, s, active)
        strains = reported(law, at_s(tensions))
        at_node = (s == self.mesh.s[step + 1])[:, None]
        return np.where(at_node, poses[step + 1], pose), strains
