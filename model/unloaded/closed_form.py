"""The explicit march: strains by tensions, poses by Magnus steps from the base.

Data flow: tensions -> tendon resultants at the steps' nodes -> strains -> poses at the nodes of the
mesh, by one Magnus step after the other from the base on. Where strains are an expression of the
resultants (the paper's balance) a step takes these; where Newton's method finds them, it takes the
strains. Both ends of each segment are the nodes of further steps, which have no length.
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
from octoplan.model.cross_section.law import size
from octoplan.model.cross_section.of_scene import cross_section_of
from octoplan.model.cross_section.sections import Sections, reported, settled
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

# Arms at a time, interpreted and by machine code: their numbers stay in the processor's cache.
_ARMS = 2048, 256
# Of log R and s/L in its meshes: errors of slender tips weigh most where strains follow tensions.
_GRADED = 1.5, 0.75
# So few steps are one list of operations, which CasADi runs sooner than a function time and again.
_WRITTEN_OUT = 64


def _step(
    statics: ClosedStatics, scheme: Magnus, by_pull: bool, least: bool = False
) -> ca.Function:
    """Return (pose, what is known of the nodes' sections, h) -> pose across a step, strains.

    Known are pull and data, or where these do not give the strains these; strains that it returns
    are tau, xi, k, q (4 m,). With `least` there are none: behind the pose is the least 1 + q so
    far.
    """
    m, law = len(scheme.nodes), statics.law
    x, h = ca.SX.sym("x", 7 + least), ca.SX.sym("h")
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
    """Return (base, what is known of all sections, h) -> poses (7, S + 1), strains (4 m, steps)."""
    march = kernel(cached(_step, statics, scheme, by_pull), machine_code).mapaccum(steps)
    inputs = march.mx_in()
    poses, strains = march.call(inputs)
    return ca.Function("march", inputs, [ca.horzcat(inputs[0], poses[:, :S]), strains])


@dataclass(frozen=True)
class _Geometry:
    """All of an arm but its material: arms that are alike in it share what `_placed` returns."""

    length: float
    radius: Path
    sections: tuple[Anchorage, ...]
    rest_curvature: RestCurvature | None
    arm: Arm = field(compare=False)


@lru_cache(maxsize=64)
def _placed(
    of: _Geometry, statics: ClosedStatics, m: int, refinement: int, at: tuple[float, ...]
) -> tuple[Mesh, Stations, Array]:
    """Return a mesh, its stations and the maps from tensions to pull there.

    The stations are m nodes a step, then both ends of each segment, the last one as often as fills
    up a step.
    """
    arm = of.arm
    taper = arm.radius
    if isinstance(taper, Linear):
        # To a tenth of its exponent: arms of about the same taper have meshes of as many steps.
        taper = Linear(1.0, math.exp(round(10 * math.log(taper.end / taper.base)) / 10))
    mesh = graded(arm, refinement, at, taper=taper, weights=_GRADED)
    (s, _, active), (ends, at_ends) = mesh.points(m), mesh.segment_ends()
    fill = 0, -ends.size % m
    ends, at_ends = np.pad(ends, fill, "edge"), np.pad(at_ends, fill, "edge")
    places = stations(arm, np.append(s, ends), np.append(active, at_ends))
    return mesh, places, statics.pulls(arm, places)


class ClosedForm(ExplicitMap):
    """The forward map of an unloaded scene on a mesh of a refinement, with arc lengths as nodes.

    Its `stretch_at` are the scheme's nodes in the steps, then both ends of each segment.
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
        self.arm, self.scene, self.scheme = arm, scene, scheme
        self.refinement, self.machine_code = refinement, machine_code
        self._statics = statics = closed_statics(scene, arm)
        alike = _Geometry(arm.length, arm.radius, arm.sections, arm.rest_curvature, arm)
        m = len(scheme.nodes)
        self.mesh, self._at, self._maps = _placed(alike, statics, m, refinement, at)
        self.stretch_at, self.radius = self._at.s, self._at.radius
        self._data, self._base = statics.data(arm, scene, self._at), base_pose(arm)
        self._h = np.pad(np.diff(self.mesh.s), (0, self.stretch_at.size // m - self.mesh.steps))
        self._kind = (statics, scheme, statics.is_explicit)
        march = cached(_march, *self._kind, machine_code, self.mesh.steps, self._h.size)
        if self._h.size <= _WRITTEN_OUT and not machine_code:
            march = cached(ca.Function.expand, march)
        self._march = cached(BufferedFunction, march)

    @cached_property
    def sections(self) -> Sections:
        """The cross-sections at the nodes of the steps, which wrenches may twist."""
        law = cross_section_of(self.scene, self.arm.is_curved)
        s, _, active = self.mesh.points(len(self.scheme.nodes))
        return Sections(self.arm, self.scene, law, s, active, self.machine_code)

    @property
    def function(self) -> ca.Function:
        """Tensions (n_tendons,) -> poses (7, S + 1), 1 + q at `stretch_at` (1, K), for CasADi."""
        T, sizes = ca.MX.sym("T", self.arm.n_tendons), (self.mesh.steps, self._h.size)
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
        """Return flat what a step takes of cross-sections that have such maps and data."""
        pull = maps.reshape(-1, tensions.size) @ tensions
        if self._statics.is_explicit:
            return [pull, data.ravel()]
        pull = pull.reshape(maps.shape[:2])
        return [settled(self._statics, pull, data, self.machine_code).ravel()]

    def many(self, tensions: Array, nodes: Sequence[int] | None = None) -> tuple[Array, Array]:
        """See ExplicitMap.many: so many arms at a time that their numbers stay at hand."""
        if len(tensions) <= FEW and not self.machine_code:
            return super().many(tensions, nodes)
        step = cached(VectorInterpreter, cached(_step, *self._kind, True), self.machine_code)
        base, some, results = np.append(self._base, np.inf)[:, None], _ARMS[self.machine_code], []
        for i in range(0, max(len(tensions), 1), some):
            known = self._columns(tensions[i : i + some])
            every, h = nodes is not None, self._h[:, None]
            (x,) = step(base, *known, h, steps=h.size, every=every)
            results.append(x.reshape(-1, 8, known[0].shape[1]).transpose(2, 0, 1))
        states = np.concatenate(results)
        poses, least = states[..., :7], states[:, -1, 7]
        # The least of numbers and of what is none is a number.
        least[np.isnan(poses[:, -1, 4])] = np.nan
        if nodes is not None:
            begin = np.broadcast_to(self._base, (len(poses), 1, 7))
            poses = np.concatenate([begin, poses], axis=1)[:, nodes]
        return poses, least

    def _columns(self, tensions: Array) -> list[Array]:
        """Return what steps take of the cross-sections of arms (M, n_tendons), by columns.

        Strains of a step at a time.
        """
        (K, n_pull, n), m, M = self._maps.shape, len(self.scheme.nodes), len(tensions)
        if self._statics.is_explicit:
            return [self._maps.reshape(-1, n) @ tensions.T, self._data.reshape(-1, 1)]
        values = []
        for k in range(0, K, m):
            maps, data = self._maps[k : k + m].reshape(-1, n), self._data[k : k + m]
            pull = (tensions @ maps.T).reshape(-1, n_pull)
            v = settled(self._statics, pull, data, self.machine_code)
            values.append(v.reshape(M, -1).T)
        return [np.concatenate(values)]

    def dense(self, tensions: Array, poses: Array, strains: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at arc lengths s, a step from the nodes below."""
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.steps - 1)
        active, left, statics = self.mesh.active[step], self.mesh.s[step], self._statics

        def at(s: Array, active: Counts) -> tuple[Array, Array]:
            places = stations(self.arm, s, active)
            return statics.pulls(self.arm, places), statics.data(self.arm, self.scene, places)

        inside = (left[:, None] + (s - left)[:, None] * np.array(self.scheme.nodes)).ravel()
        known = self._known(*at(inside, np.repeat(active, len(self.scheme.nodes))), tensions)
        across = cached(BatchFunction, cached(_step, *self._kind))
        pose, _ = across(poses[step], *(each.reshape(s.size, -1) for each in known), s - left)
        maps, data = at(s, active)
        there = reported(statics.law, settled(statics, maps @ tensions, data))
        at_node = (s == self.mesh.s[step + 1])[:, None]
        return np.where(at_node, poses[step + 1], pose), there
