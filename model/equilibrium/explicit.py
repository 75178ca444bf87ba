"""Explicit forward maps, of arms with independent cross-sections, and their equilibria.

The strains of each cross-section follow from the tensions, and the poses from the strains. In the
closed form, tensions give the resultants of the tendons at the nodes of the steps, then strains,
then poses at the nodes of the mesh, step by step from the base. With the paper's balance, whose
strains are explicit, a step takes the resultants. Otherwise Newton's method solves for the strains,
and a step takes the strains. Steps of length 0 at both ends of each segment report the strains
there.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca
import numpy as np

from octoplan.model.anchorage import Anchorage, RestCurvature
from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import cross_section_of, size
from octoplan.model.cross_section.sections import Extremes, Sections, reported, solve_sections
from octoplan.model.cross_section.statics import ClosedStatics, closed_statics
from octoplan.model.mesh import Counts, Mesh, Stations, base_pose, graded, stations
from octoplan.model.paths import Array, Linear, Path
from octoplan.model.rod.collocation import Magnus
from octoplan.model.rotations import compose
from octoplan.model.scene import Scene
from octoplan.model.support.machine.compiled import kernel
from octoplan.model.support.machine.functions import (
    FEW,
    BatchFunction,
    BufferedFunction,
    VectorInterpreter,
    cached,
)
from octoplan.model.tendons import Lengths, tendon_lengths

if TYPE_CHECKING:
    from octoplan.model.equilibrium.runge_kutta import RungeKutta

# Number of arms per batch with interpreted and with compiled code, whose data fit into the cache.
_BATCH = (2048, 256)
# Weights of log R and of s/L in the mesh: slender tips have the largest errors.
_MESH_WEIGHTS = (1.5, 0.75)
# Largest number of steps that CasADi expands to a single list of operations, which is then faster
# than repeated calls of a function.
_MAX_EXPANDED = 64


class ExplicitMap(ABC):
    """The forward map of an arm with independent cross-sections on a mesh.

    Attributes
    ----------
    scheme : Magnus or RungeKutta
        The integrator of the poses, or of poses and strains.
    refinement : int
        The refinement of the mesh.
    stretch_at : (K,)
        Arc lengths at which strains are reported [m].
    radius : (K,)
        Radius of the body there [m].
    """

    # Error of the tip by rounding, over the arm's length.
    rounding: ClassVar[float] = 1e-14
    # Processor time that the equilibrium on a mesh may take [s].
    patience: ClassVar[float] = math.inf
    # Whether a cross-section without an equilibrium has none on a finer mesh either.
    sections_are_exact: ClassVar[bool] = True

    arm: Arm
    scene: Scene
    scheme: Magnus | RungeKutta
    refinement: int
    machine_code: bool
    mesh: Mesh
    stretch_at: Array
    radius: Array

    def __reduce__(self) -> tuple[Any, ...]:
        arguments = self.arm, self.scene, self.scheme, self.refinement, (), self.machine_code
        return cached, (type(self), *arguments)

    @property
    @abstractmethod
    def function(self) -> ca.Function:
        """Tensions (n_tendons,) -> poses (7, S + 1), 1 + q at `stretch_at` (1, K), for CasADi."""

    @abstractmethod
    def run(self, tensions: Array) -> tuple[Array, Array]:
        """Return poses (S + 1, 7) at the nodes, and tau, xi, k, q (K, 4) at `stretch_at`."""

    @abstractmethod
    def dense(self, tensions: Array, poses: Array, strains: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at s (N,) [m], from the results of `run`."""

    def many(self, tensions: Array, nodes: Sequence[int] | None = None) -> tuple[Array, Array]:
        """Return poses (M, nodes, 7) under tensions (M, n_tendons), and the least 1 + q (M,).

        The default of `nodes` is the last node.
        """
        nodes = [-1] if nodes is None else nodes
        values = [self.run(T) for T in tensions]
        poses = np.array([rows[nodes] for rows, _ in values]).reshape(-1, len(nodes), 7)
        return poses, np.array([1 + strains[:, 3].min() for _, strains in values])

    def solve(
        self, tensions: Array, near: object = None, tolerance_factor: float = 1.0
    ) -> ExplicitEquilibrium:
        """Return the equilibrium under tensions (n_tendons,); other arguments have no effect."""
        return ExplicitEquilibrium(self, tensions, *self.run(tensions))

    def tendon_lengths(self, point: ExplicitEquilibrium) -> Array:
        """Return the lengths of the tendons (n_tendons,) in an equilibrium of this map [m]."""
        return point.tendons.lengths


@dataclass(frozen=True, eq=False)
class ExplicitEquilibrium:
    """An equilibrium of an arm with independent cross-sections.

    The interface is that of octoplan.model.equilibrium.linearised.Equilibrium.

    Attributes
    ----------
    forward : ExplicitMap
    tensions : (n_tendons,)
        [N].
    poses : (N + 1, 7)
        Quaternions and positions [m] at the nodes.
    strains : (K, 4)
        tau, xi, k, q at the `stretch_at` of the map.
    """

    # See Equilibrium.
    snaps: ClassVar[tuple[float, ...]] = ()

    forward: ExplicitMap
    tensions: Array
    poses: Array
    strains: Array

    @property
    def mesh(self) -> Mesh:
        """See Equilibrium."""
        return self.forward.mesh

    @property
    def scheme(self) -> str:
        """See Equilibrium."""
        return self.forward.scheme.name

    @cached_property
    def extremes(self) -> Extremes:
        """See Equilibrium."""
        _, xi, k, q = self.strains.T
        return Extremes.of(self.forward.stretch_at, q, np.hypot(xi, k), self.forward.radius)

    @property
    def machine_code(self) -> bool:
        """See Equilibrium."""
        return self.forward.machine_code

    def at(self, s: Array) -> tuple[Array, Array]:
        """See Equilibrium: one step of the integrator from the node next to s."""
        return self.forward.dense(self.tensions, self.poses, self.strains, s)

    @cached_property
    def tendons(self) -> Lengths:
        """The tendons under the tensions, with closed-form strains."""
        forward = self.forward
        return tendon_lengths(forward.arm, forward.scene, forward.machine_code)(self.tensions)

    @property
    def length_tension(self) -> Array:
        """See Equilibrium. Undefined for the equations as printed."""
        return self.tendons.length_tension

    @cached_property
    def lengths(self) -> Array:
        """See Equilibrium: the integral of ``|du_c/ds|`` by Gauss quadrature."""
        return self.forward.tendon_lengths(self)


def _step(
    statics: ClosedStatics, scheme: Magnus, by_pull: bool, least: bool = False
) -> ca.Function:
    """Return (pose, inputs of the sections, h) -> pose after a step, strains tau, xi, k, q (4 m,).

    Inputs of the m cross-sections are pull and data with `by_pull`, otherwise the strains. With
    `least` the pose is followed by the least 1 + q so far, and no strains are returned.
    """
    m = len(scheme.nodes)
    law = statics.law
    x = ca.SX.sym("x", 7 + least)
    h = ca.SX.sym("h")
    if by_pull:
        known = [ca.SX.sym("pull", statics.n_pull, m), ca.SX.sym("data", statics.n_data, m)]
        sections = [statics.solve(*pair) for pair in zip(*map(ca.horzsplit, known), strict=True)]
    else:
        known = [ca.SX.sym("v", size(law), m)]
        sections = ca.horzsplit(known[0])
    after = compose(x[:7], scheme.step([ca.vertcat(*law.twist(v)) for v in sections], h))
    strains = ca.horzcat(*(law.reported(v) for v in sections))
    results = [after, ca.densify(ca.vec(strains))]
    if least:
        results = [ca.vertcat(after, ca.fmin(x[7], 1 + ca.mmin(strains[3, :])))]
    return ca.Function("step", [x, *map(ca.vec, known), h], results, {"cse": True})


def _integrator(
    statics: ClosedStatics, scheme: Magnus, by_pull: bool, machine_code: bool, S: int, steps: int
) -> ca.Function:
    """Return (base, inputs of all sections, h) -> poses (7, S + 1), strains (4 m, steps)."""
    steps_along = kernel(cached(_step, statics, scheme, by_pull), machine_code).mapaccum(steps)
    inputs = steps_along.mx_in()
    poses, strains = steps_along.call(inputs)
    return ca.Function("integrator", inputs, [ca.horzcat(inputs[0], poses[:, :S]), strains])


@dataclass(frozen=True)
class _Geometry:
    """The geometry of an arm, without material: the key under which meshes are cached."""

    length: float
    radius: Path
    sections: tuple[Anchorage, ...]
    rest_curvature: RestCurvature | None
    arm: Arm = field(compare=False)


@lru_cache(maxsize=64)
def _placed(
    of: _Geometry, statics: ClosedStatics, m: int, refinement: int, at: tuple[float, ...]
) -> tuple[Mesh, Stations, Array]:
    """Return a mesh, its stations, and the maps from tensions to pull at the stations.

    Stations are the m nodes of each step, then both ends of each segment. The last end is repeated
    to fill a step.
    """
    arm = of.arm
    taper = arm.radius
    if isinstance(taper, Linear):
        # Rounded exponent: arms of a similar taper have meshes with the same number of steps.
        taper = Linear(1.0, math.exp(round(10 * math.log(taper.end / taper.base)) / 10))
    mesh = graded(arm, refinement, at, taper=taper, weights=_MESH_WEIGHTS)
    s, _, active = mesh.points(m)
    ends, at_ends = mesh.segment_ends()
    fill = (0, -ends.size % m)
    ends = np.pad(ends, fill, "edge")
    at_ends = np.pad(at_ends, fill, "edge")
    places = stations(arm, np.append(s, ends), np.append(active, at_ends))
    return mesh, places, statics.resultant_maps(arm, places)


class ClosedForm(ExplicitMap):
    """The forward map of a scene without loads.

    `stretch_at` contains the nodes of all steps, then both ends of each segment.
    """

    scheme: Magnus

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        scheme: Magnus,
        refinement: int,
        at: tuple[float, ...] = (),
        machine_code: bool = False,
    ) -> None:
        self.arm = arm
        self.scene = scene
        self.scheme = scheme
        self.refinement = refinement
        self.machine_code = machine_code
        self._statics = statics = closed_statics(scene, arm)
        alike = _Geometry(arm.length, arm.radius, arm.sections, arm.rest_curvature, arm)
        m = len(scheme.nodes)
        self.mesh, self._at, self._maps = _placed(alike, statics, m, refinement, at)
        self.stretch_at = self._at.s
        self.radius = self._at.radius
        self._data = statics.data(arm, scene, self._at)
        self._base = base_pose(arm)
        self._h = np.pad(np.diff(self.mesh.s), (0, self.stretch_at.size // m - self.mesh.elements))
        by_pull = statics.is_explicit
        integrator = cached(
            _integrator, statics, scheme, by_pull, machine_code, self.mesh.elements, self._h.size
        )
        if self._h.size <= _MAX_EXPANDED and not machine_code:
            integrator = cached(ca.Function.expand, integrator)
        self._integrate = cached(BufferedFunction, integrator)

    @cached_property
    def sections(self) -> Sections:
        """The cross-sections at the nodes of the steps, with torsion."""
        law = cross_section_of(self.scene, self.arm.is_curved)
        s, _, active = self.mesh.points(len(self.scheme.nodes))
        return Sections(self.arm, self.scene, law, s, active, self.machine_code)

    @property
    def function(self) -> ca.Function:
        """See ExplicitMap."""
        T = ca.MX.sym("T", self.arm.n_tendons)
        pull = ca.sparsify(ca.DM(self._maps.reshape(-1, T.numel()))) @ T
        known = [ca.reshape(each, -1, self._h.size) for each in (pull, ca.DM(self._data.T))]
        integrator = cached(
            _integrator,
            self._statics,
            self.scheme,
            True,
            self.machine_code,
            self.mesh.elements,
            self._h.size,
        )
        poses, strains = integrator(self._base, *known, ca.DM(self._h).T)
        along = ca.reshape(strains, 4, -1)[3, :]
        return ca.Function("closed_form", [T], [poses, 1 + along])

    def run(self, tensions: Array) -> tuple[Array, Array]:
        """See ExplicitMap.run."""
        known = self._known(self._maps, self._data, tensions)
        poses, strains = self._integrate(self._base, *known, self._h)
        return poses, strains.reshape(-1, 4)

    def _known(self, maps: Array, data: Array, tensions: Array) -> list[Array]:
        """Return the inputs of the sections, flat, for maps from tensions to pull, and data."""
        pull = maps.reshape(-1, tensions.size) @ tensions
        if self._statics.is_explicit:
            return [pull, data.ravel()]
        pull = pull.reshape(maps.shape[:2])
        return [solve_sections(self._statics, pull, data, self.machine_code).ravel()]

    def many(self, tensions: Array, nodes: Sequence[int] | None = None) -> tuple[Array, Array]:
        """See ExplicitMap.many: in batches."""
        if len(tensions) <= FEW and not self.machine_code:
            return super().many(tensions, nodes)
        one_step = cached(_step, self._statics, self.scheme, self._statics.is_explicit, True)
        step = cached(VectorInterpreter, one_step, self.machine_code)
        base = np.append(self._base, np.inf)[:, None]
        some = _BATCH[self.machine_code]
        every = nodes is not None
        h = self._h[:, None]
        results = []
        for i in range(0, max(len(tensions), 1), some):
            known = self._columns(tensions[i : i + some])
            (x,) = step(base, *known, h, steps=h.size, every=every)
            results.append(x.reshape(-1, 8, known[0].shape[1]).transpose(2, 0, 1))
        states = np.concatenate(results)
        poses = states[..., :7]
        least = states[:, -1, 7]
        # fmin ignores NaN.
        least[np.isnan(poses[:, -1, 4])] = np.nan
        if nodes is not None:
            begin = np.broadcast_to(self._base, (len(poses), 1, 7))
            poses = np.concatenate([begin, poses], axis=1)[:, nodes]
        return poses, least

    def _columns(self, tensions: Array) -> list[Array]:
        """Return the inputs of the sections under tensions (M, n_tendons), one column per set.

        Strains are solved step by step.
        """
        K, n_pull, n = self._maps.shape
        m = len(self.scheme.nodes)
        M = len(tensions)
        if self._statics.is_explicit:
            return [self._maps.reshape(-1, n) @ tensions.T, self._data.reshape(-1, 1)]
        values = []
        for k in range(0, K, m):
            maps = self._maps[k : k + m].reshape(-1, n)
            data = self._data[k : k + m]
            pull = (tensions @ maps.T).reshape(-1, n_pull)
            v = solve_sections(self._statics, pull, data, self.machine_code)
            values.append(v.reshape(M, -1).T)
        return [np.concatenate(values)]

    def dense(self, tensions: Array, poses: Array, strains: Array, s: Array) -> tuple[Array, Array]:
        """See ExplicitMap.dense: one step from the node below s."""
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.elements - 1)
        active = self.mesh.active[step]
        left = self.mesh.s[step]
        statics = self._statics

        def at(s: Array, active: Counts) -> tuple[Array, Array]:
            places = stations(self.arm, s, active)
            return statics.resultant_maps(self.arm, places), statics.data(
                self.arm, self.scene, places
            )

        inside = (left[:, None] + (s - left)[:, None] * np.array(self.scheme.nodes)).ravel()
        known = self._known(*at(inside, np.repeat(active, len(self.scheme.nodes))), tensions)
        one_step = cached(_step, self._statics, self.scheme, self._statics.is_explicit)
        across = cached(BatchFunction, one_step)
        pose, _ = across(poses[step], *(each.reshape(s.size, -1) for each in known), s - left)
        maps, data = at(s, active)
        there = reported(statics.law, solve_sections(statics, maps @ tensions, data))
        at_node = (s == self.mesh.s[step + 1])[:, None]
        return np.where(at_node, poses[step + 1], pose), there
