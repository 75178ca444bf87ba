"""The explicit march: strains by tensions, poses by Magnus steps from the base.

Data flow: tensions -> tendon resultants at the steps' nodes -> strains -> poses at the nodes of the
mesh, by one Magnus step after the other from the base on. Where strains are an expression of the
resultants (the paper's balance) a step takes these; where they are found by Newton's method, it
takes the strains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.arm import Arm
from model.cross_section import cross_section_of
from model.cross_section.law import CrossSection, reported, size
from model.cross_section.sections import Sections
from model.integrators import Magnus
from model.machine.buffered import Buffered, mapped
from model.machine.columns import Columns
from model.machine.compiled import built, kernel
from model.mesh import Mesh, graded, roughly
from model.paths import Array, Path
from model.rotations import compose
from model.scene import Scene
from model.stations import Counts, base_pose, stations
from model.unloaded.sections import StrainsByTensions
from model.unloaded.statics import ClosedStatics

# E A, E J and G I come first among the data of a cross-section.
_BODY = 3
# Arms at a time, interpreted and by machine code: their numbers stay in the processor's cache.
_ARMS = 2048, 512
# So few are marched one after the other, where they are interpreted.
_FEW = 256
# Of log R and s/L in its meshes: errors of slender tips weigh most where strains follow tensions.
_GRADED = 1.5, 0.75
# So few steps are one list of operations, which CasADi runs sooner than a function time and again.
_WRITTEN_OUT = 64


@dataclass(frozen=True)
class Geometry:
    """An arm whatever it is made of: equal to another of the same tendons and taper.

    Attributes
    ----------
    taper : Path
        What its meshes are graded for.
    numbers : tuple
        All else that meshes and paths of tendons depend on.
    """

    arm: Arm = field(compare=False)
    taper: Path
    numbers: tuple[Any, ...]

    @classmethod
    def of(cls, arm: Arm) -> Geometry:
        """Return the geometry of an arm."""
        body = arm.length, arm.sections, arm.rest_curvature, arm.base_frame, arm.base_position
        return cls(arm, roughly(arm.radius), body)


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
    arm = geometry.arm
    mesh = graded(arm, refinement, at, taper=geometry.taper, weights=_GRADED)
    ends, at_ends = mesh.segment_ends()
    s, _, active = mesh.points(len(scheme.nodes))
    s, active = np.concatenate([s, ends]), np.concatenate([active, at_ends])
    there = stations(arm, s, active)
    maps, others = statics.pulls(arm, there), statics.data(there)[_BODY:].T
    return GeometryOnMesh(mesh, s, active, maps, others, base_pose(arm), np.diff(mesh.s))


def nodes_of(scheme: Magnus, left: Array, right: Array) -> Array:
    """Return the arc lengths (m N,) of a scheme's nodes in N steps."""
    return np.ravel(left[:, None] + (right - left)[:, None] * np.array(scheme.nodes))


def _strains(statics: ClosedStatics, m: int, by_pull: bool) -> tuple[list[ca.SX], ca.SX]:
    """Return what a step takes of m cross-sections, by column, and their strains (n, m) of it.

    Pull and data, or where these do not give the strains the strains.
    """
    if not by_pull:
        v = ca.SX.sym("v", size(statics.law), m)
        return [v], v
    pull, data = ca.SX.sym("pull", statics.n_pull, m), ca.SX.sym("data", statics.n_data, m)
    pairs = zip(ca.horzsplit(pull), ca.horzsplit(data), strict=True)
    return [pull, data], ca.horzcat(*(statics.solve(*pair) for pair in pairs))


def _step(
    statics: ClosedStatics, scheme: Magnus, by_pull: bool, columns: bool = False
) -> ca.Function:
    """Return (pose, what is known of the nodes' sections, h) -> pose across a step, strains.

    With `columns` the least 1 + q of the nodes in place of their strains.
    """
    known, v = _strains(statics, len(scheme.nodes), by_pull)
    g, h, sections = ca.SX.sym("g", 7), ca.SX.sym("h"), ca.horzsplit(v)
    twists = [ca.vertcat(*statics.law.twist(one)) for one in sections]
    after = compose(g, scheme.step(twists, h))
    stretch = ca.vertcat(*(1 + statics.law.reported(one)[3] for one in sections))
    results = [after, ca.mmin(stretch) if columns else ca.vec(v)]
    arguments = [g, *map(ca.vec, known), h]
    return ca.Function("marched", arguments, results, {"cse": True})


def _many_arms(
    statics: ClosedStatics, scheme: Magnus, machine_code: bool
) -> tuple[Columns, Columns]:
    """Return a step of many arms, and the least of a number and of 1 + q at a cross-section."""
    known, v = _strains(statics, 1, statics.is_explicit)
    least = ca.SX.sym("least")
    both = ca.fmin(least, 1 + statics.law.reported(v)[3])
    end = ca.Function("least", [least, *known], [both], {"cse": True})
    step = _step(statics, scheme, statics.is_explicit, columns=True)
    return Columns(step, machine_code), Columns(end, machine_code)


def _march(
    statics: ClosedStatics,
    scheme: Magnus,
    steps: int,
    ends: int,
    by_pull: bool,
    machine_code: bool,
) -> ca.Function:
    """Return (base, what is known of K sections, h) -> poses (7, steps + 1), strains (n, K).

    The sections are those of the steps' nodes, then of `ends`.
    """
    inner, step = steps * len(scheme.nodes), built(_step, statics, scheme, by_pull)
    step = kernel(step, machine_code)
    symbols, v = _strains(statics, 1, by_pull)
    section = kernel(ca.Function("section", symbols, [ca.densify(v)], {"cse": True}), machine_code)
    g, h = ca.MX.sym("g", 7), ca.MX.sym("h", 1, steps)
    known = [ca.MX.sym("known", each.numel(), inner + ends) for each in symbols]
    at_nodes = [ca.reshape(each[:, :inner], -1, steps) for each in known]
    poses, strains = step.mapaccum(steps)(g, *at_nodes, h)
    at_ends = section.map(ends)(*(each[:, inner:] for each in known))
    results = [ca.horzcat(g, poses), ca.horzcat(ca.reshape(strains, -1, inner), at_ends)]
    return ca.Function("march", [g, *known, h], results)


def _called(statics: ClosedStatics, scheme: Magnus, steps: int, *others: int | bool) -> Buffered:
    """Return what `_march` does, to be called: few steps that are interpreted are written out."""
    march, machine_code = built(_march, statics, scheme, steps, *others), others[-1]
    few = steps <= _WRITTEN_OUT and not machine_code
    return Buffered(march.expand() if few else march)


class ClosedForm:
    """The forward map of an unloaded scene on one mesh.

    Attributes
    ----------
    strains : StrainsByTensions
        The strains at the arc lengths `stretch_at` (K,), the scheme's nodes in the steps and both
        ends of each segment.
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
        self.strains = StrainsByTensions(statics, places.maps, places.data(arm), machine_code)
        self.stretch_at, self._places, self._statics = places.at, places, statics
        self._inner = self.mesh.steps * len(scheme.nodes)
        self._march = built(_called, *self._structure(statics.is_explicit))

    def _structure(self, by_pull: bool) -> tuple[Any, ...]:
        """Return what the march is built for; see _march."""
        ends = self.stretch_at.size - self._inner
        steps = self.mesh.steps, ends
        return self._statics, self.scheme, *steps, by_pull, self.machine_code

    @property
    def law(self) -> CrossSection:
        """The law of the cross-sections, whose strains these are."""
        return self._statics.law

    @cached_property
    def sections(self) -> Sections:
        """The cross-sections at the nodes of the steps, which wrenches may twist."""
        law, inner = cross_section_of(self.scene, self.arm.is_curved), slice(self._inner)
        where = self.stretch_at[inner], self._places.active[inner]
        return Sections(self.arm, self.scene, law, *where, self.machine_code)

    @property
    def function(self) -> ca.Function:
        """Tensions (n_tendons,) -> poses (7, S + 1), 1 + q at `stretch_at` (1, K), for CasADi."""
        T, law, maps = ca.MX.sym("T", self.arm.n_tendons), self.law, self.strains.maps
        K, n_pull, n = maps.shape
        pull = ca.reshape(ca.sparsify(ca.DM(maps.reshape(-1, n))) @ T, n_pull, K)
        at = self._places.base, pull, ca.DM(self.strains.data.T), ca.DM(self._places.h).T
        poses, v = built(_march, *self._structure(True))(*at)
        along = v[2, :] - law.along_at_rest if law.extension else 0 * v[0, :]
        return ca.Function("closed_form", [T], [ca.densify(poses), ca.densify(1 + along)])

    def run(self, tensions: Array) -> tuple[Array, Array, Array]:
        """See March.run: poses (S + 1, 7), 1 + q (K,) and strains of the law."""
        known = self.strains.known(tensions)
        poses, v = self._march(self._places.base, *known, self._places.h)
        return poses, self._stretch(v), v

    def bend(self, strains: Array) -> float:
        """See March.bend, by the radius that E J and E A are of."""
        bend = np.hypot(strains[:, 0], strains[:, 1]) * self._radius
        if not self._statics.is_explicit:  # whose curvatures are per reference length
            bend /= self._stretch(strains)
        return float(bend.max())

    @cached_property
    def _radius(self) -> Array:
        EA, EJ = self.strains.data[:, :2].T
        return np.asarray(2 * np.sqrt(EJ / EA))

    def many(self, tensions: Array, nodes: Sequence[int]) -> tuple[Array, Array]:
        """See March.many: so many arms at a time that their numbers stay at hand."""
        if len(tensions) <= _FEW and not self.machine_code:
            arms = [self.run(T) for T in tensions]
            rows = np.array([rows[nodes] for rows, *_ in arms]).reshape(-1, len(nodes), 7)
            return rows, np.array([stretch.min() for _, stretch, _ in arms])
        some = _ARMS[self.machine_code]
        starts = range(0, max(len(tensions), 1), some)
        parts = [self._many(tensions[i : i + some], nodes) for i in starts]
        poses, least = zip(*parts, strict=True)
        return np.concatenate(poses), np.concatenate(least)

    def _many(self, tensions: Array, nodes: Sequence[int]) -> tuple[Array, Array]:
        M, S = len(tensions), self.mesh.steps
        base, h = np.tile(self._places.base[:, None], M), self._places.h[:, None]
        march, end = built(_many_arms, self._statics, self.scheme, self.machine_code)
        known = self.strains.columns(tensions, len(self.scheme.nodes))
        cuts = [len(each) // self.stretch_at.size * self._inner for each in known]
        at_nodes = [each[:cut] for each, cut in zip(known, cuts, strict=True)]
        at_ends = [each[cut:] for each, cut in zip(known, cuts, strict=True)]
        poses, stretch = march(base, *at_nodes, h, steps=S)
        ends = end(stretch.min(axis=0)[None], *at_ends, steps=self.stretch_at.size - self._inner)
        least = ends[0][-1]
        if not self._statics.is_explicit:
            least = np.where(np.isnan(known[0]).any(axis=0), np.nan, least)
        poses = np.concatenate([base[None], poses.reshape(S, 7, M)])
        return poses[nodes].transpose(2, 0, 1), least

    def _stretch(self, v: Array) -> Array:
        """Return 1 + q (..., K) of strains (..., K, n); NaN where these are none."""
        law = self.law
        if not law.extension:
            return 1 + 0 * v[..., 0]
        return np.asarray(v[..., 2] + (1.0 - law.along_at_rest))

    def dense(self, tensions: Array, poses: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at arc lengths s, a step from the nodes below."""
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.steps - 1)
        active, left, statics = self.mesh.active[step], self.mesh.s[step], self._statics
        inside = nodes_of(self.scheme, left, s), np.repeat(active, len(self.scheme.nodes))
        known = StrainsByTensions.at(self.arm, statics, *inside).known(tensions)
        across = mapped(built(_step, statics, self.scheme, statics.is_explicit))
        pose, _ = across(poses[step], *(each.reshape(s.size, -1) for each in known), s - left)
        strains = reported(self.law, StrainsByTensions.at(self.arm, statics, s, active)(tensions))
        at_node = (s == self.mesh.s[step + 1])[:, None]
        return np.where(at_node, poses[step + 1], pose), strains
