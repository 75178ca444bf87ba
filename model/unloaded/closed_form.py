"""The closed form: strains from tensions, then poses by Magnus steps from the base.

Data flow: tensions -> resultants of the tendons at the nodes of the steps -> strains -> poses at
the nodes of the mesh, step by step from the base. With the paper's balance, whose strains are
explicit, a step takes the resultants. Otherwise Newton's method solves for the strains, and a step
takes the strains. Steps of length 0 at both ends of each segment report the strains there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from octoplan.model.anchorage import Anchorage, RestCurvature
from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import cross_section_of, size
from octoplan.model.cross_section.sections import Sections, reported, solve_sections
from octoplan.model.cross_section.statics import ClosedStatics, closed_statics
from octoplan.model.integrators import Magnus
from octoplan.model.mesh import Mesh, graded
from octoplan.model.paths import Array, Linear, Path
from octoplan.model.rotations import compose
from octoplan.model.scene import Scene
from octoplan.model.stations import Counts, Stations, base_pose, stations
from octoplan.model.support.machine.compiled import kernel
from octoplan.model.support.machine.functions import (
    FEW,
    BatchFunction,
    BufferedFunction,
    VectorInterpreter,
    cached,
)
from octoplan.model.unloaded.marched import ExplicitMap

# Number of arms per batch with interpreted and with compiled code, whose data fit into the cache.
_BATCH = (2048, 256)
# Weights of log R and of s/L in the mesh: slender tips have the largest errors.
_MESH_WEIGHTS = (1.5, 0.75)
# Largest number of steps that CasADi expands to a single list of operations, which is then faster
# than repeated calls of a function.
_MAX_EXPANDED = 64


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
    return ca.Function("marched", [x, *map(ca.vec, known), h], results, {"cse": True})


def _march(
    statics: ClosedStatics, scheme: Magnus, by_pull: bool, machine_code: bool, S: int, steps: int
) -> ca.Function:
    """Return (base, inputs of all sections, h) -> poses (7, S + 1), strains (4 m, steps)."""
    march = kernel(cached(_step, statics, scheme, by_pull), machine_code).mapaccum(steps)
    inputs = march.mx_in()
    poses, strains = march.call(inputs)
    return ca.Function("march", inputs, [ca.horzcat(inputs[0], poses[:, :S]), strains])


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
        self._h = np.pad(np.diff(self.mesh.s), (0, self.stretch_at.size // m - self.mesh.steps))
        self._kind = (statics, scheme, statics.is_explicit)
        march = cached(_march, *self._kind, machine_code, self.mesh.steps, self._h.size)
        if self._h.size <= _MAX_EXPANDED and not machine_code:
            march = cached(ca.Function.expand, march)
        self._march = cached(BufferedFunction, march)

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
        sizes = (self.mesh.steps, self._h.size)
        pull = ca.sparsify(ca.DM(self._maps.reshape(-1, T.numel()))) @ T
        known = [ca.reshape(each, -1, self._h.size) for each in (pull, ca.DM(self._data.T))]
        march = cached(_march, self._statics, self.scheme, True, self.machine_code, *sizes)
        poses, strains = march(self._base, *known, ca.DM(self._h).T)
        along = ca.reshape(strains, 4, -1)[3, :]
        return ca.Function("closed_form", [T], [poses, 1 + along])

    def run(self, tensions: Array) -> tuple[Array, Array]:
        """See ExplicitMap.run."""
        known = self._known(self._maps, self._data, tensions)
        poses, strains = self._march(self._base, *known, self._h)
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
        step = cached(VectorInterpreter, cached(_step, *self._kind, True), self.machine_code)
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
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.steps - 1)
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
        across = cached(BatchFunction, cached(_step, *self._kind))
        pose, _ = across(poses[step], *(each.reshape(s.size, -1) for each in known), s - left)
        maps, data = at(s, active)
        there = reported(statics.law, solve_sections(statics, maps @ tensions, data))
        at_node = (s == self.mesh.s[step + 1])[:, None]
        return np.where(at_node, poses[step + 1], pose), there
