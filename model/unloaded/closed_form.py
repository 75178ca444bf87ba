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

from model.anchorage import Anchorage, RestCurvature
from model.arm import Arm
from model.cross_section import cross_section_of
from model.cross_section.law import reported, size
from model.cross_section.sections import Sections
from model.integrators import Magnus
from model.machine.buffered import Buffered, mapped
from model.machine.columns import Columns
from model.machine.compiled import built, kernel
from model.mesh import Mesh, graded, roughly
from model.paths import Array, Path
from model.rotations import compose
from model.scene import Scene
from model.stations import Stations, base_pose, stations
from model.unloaded.marched import March
from model.unloaded.sections import StrainsByTensions
from model.unloaded.statics import ClosedStatics, closed_statics

# Arms at a time, interpreted and by machine code: their numbers stay in the processor's cache.
_ARMS = 2048, 512
# So few are marched one after the other, where they are interpreted.
_FEW = 256
# Of log R and s/L in its meshes: errors of slender tips weigh most where strains follow tensions.
_GRADED = 1.5, 0.75
# So few steps are one list of operations, which CasADi runs sooner than a function time and again.
_WRITTEN_OUT = 64


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
    statics: ClosedStatics, scheme: Magnus, by_pull: bool, least: bool = False
) -> ca.Function:
    """Return (pose, what is known of the nodes' sections, h) -> pose across a step, strains.

    With `least` the least 1 + q of the nodes in place of their strains.
    """
    known, v = _strains(statics, len(scheme.nodes), by_pull)
    g, h, sections = ca.SX.sym("g", 7), ca.SX.sym("h"), ca.horzsplit(v)
    twists = [ca.vertcat(*statics.law.twist(one)) for one in sections]
    after = compose(g, scheme.step(twists, h))
    stretch = ca.vertcat(*(1 + statics.law.reported(one)[3] for one in sections))
    results = [after, ca.mmin(stretch) if least else ca.vec(v)]
    arguments = [g, *map(ca.vec, known), h]
    return ca.Function("marched", arguments, results, {"cse": True})


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

    The stations are m nodes a step, then both ends of each segment.
    """
    arm = of.arm
    # Arms of about the same taper have meshes of as many steps.
    mesh = graded(arm, refinement, at, taper=roughly(arm.radius), weights=_GRADED)
    (s, _, active), (ends, at_ends) = mesh.points(m), mesh.segment_ends()
    places = stations(arm, np.append(s, ends), np.append(active, at_ends))
    return mesh, places, statics.pulls(arm, places)


class ClosedForm(March):
    """The forward map of an unloaded scene on a mesh of a refinement, with arc lengths as nodes.

    Attributes
    ----------
    stretch_at : (K,)
        Arc lengths: the scheme's nodes in the steps, then both ends of each segment [m].
    strains : StrainsByTensions
        The strains there.
    law : CrossSection
        Whose strains these are.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        scheme: Magnus,
        refinement: int,
        at: tuple[float, ...] = (),
        machine_code: bool = False,
    ) -> None:
        self.arm, self.scene, self.scheme, self.name = arm, scene, scheme, scheme.name
        self.refinement, self.machine_code = refinement, machine_code
        self._statics = statics = closed_statics(scene, arm)
        alike = _Geometry(arm.length, arm.radius, arm.sections, arm.rest_curvature, arm)
        m = len(scheme.nodes)
        self.mesh, self._at, maps = _placed(alike, statics, m, refinement, at)
        self._inner, self.stretch_at, self.law = m * self.mesh.steps, self._at.s, statics.law
        data = statics.data(arm.material, self._at)
        self.strains = StrainsByTensions(statics, maps, data, machine_code)
        self._base, self._h = base_pose(arm), np.diff(self.mesh.s)
        self._march = built(_called, *self._structure(self._statics.is_explicit))

    def _structure(self, by_pull: bool) -> tuple[Any, ...]:
        """Return what the march is built for; see _march."""
        steps = self.mesh.steps, self.stretch_at.size - self._inner
        return self._statics, self.scheme, *steps, by_pull, self.machine_code

    @cached_property
    def sections(self) -> Sections:
        """The cross-sections at the nodes of the steps, which wrenches may twist."""
        law, inner = cross_section_of(self.scene, self.arm.is_curved), slice(self._inner)
        where = self._at.s[inner], self._at.active[inner]
        return Sections(self.arm, self.scene, law, *where, self.machine_code)

    @property
    def function(self) -> ca.Function:
        """Tensions (n_tendons,) -> poses (7, S + 1), 1 + q at `stretch_at` (1, K), for CasADi."""
        T, maps = ca.MX.sym("T", self.arm.n_tendons), self.strains.maps
        K, n_pull, n = maps.shape
        pull = ca.reshape(ca.sparsify(ca.DM(maps.reshape(-1, n))) @ T, n_pull, K)
        at = self._base, pull, ca.DM(self.strains.data.T), ca.DM(self._h).T
        poses, v = built(_march, *self._structure(True))(*at)
        along = v[2, :] - self.law.along_at_rest if self.law.extension else 0 * v[0, :]
        return ca.Function("closed_form", [T], [ca.densify(poses), ca.densify(1 + along)])

    def run(self, tensions: Array) -> tuple[Array, Array, Array]:
        """See March.run: strains are those of the law."""
        poses, v = self._march(self._base, *self.strains.known(tensions), self._h)
        return poses, self._stretch(v), v

    def bend(self, strains: Array, stretch: Array) -> float:
        """See March.bend: of curvature per unit deformed length."""
        bend = self._at.radius * np.hypot(strains[:, 0], strains[:, 1])
        if not self._statics.is_explicit:  # whose curvatures are per reference length
            bend /= stretch
        return float(bend[bend.argmax()])

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
        M, S, m = len(tensions), self.mesh.steps, len(self.scheme.nodes)
        of = self._statics, self.scheme, self._statics.is_explicit, True
        step = built(Columns, built(_step, *of), self.machine_code)
        base, known = (
            np.tile(self._base[:, None], M),
            self.strains.columns(tensions, self._inner, m),
        )
        poses, stretch = step(base, *known, self._h[:, None], steps=S)
        poses = np.concatenate([base[None], poses.reshape(S, 7, M)])
        at_ends = self._stretch(self.strains.of_many(tensions, slice(self._inner, None)))
        least = np.minimum(stretch.min(axis=0), at_ends.min(axis=1))
        # The least of numbers and of what is none is a number.
        least[np.isnan(poses[-1, 4])] = np.nan
        return poses[nodes].transpose(2, 0, 1), least

    def _stretch(self, v: Array) -> Array:
        """Return 1 + q (..., K) of strains (..., K, n); NaN where these are none."""
        if not self.law.extension:
            return 1 + 0 * v[..., 0]
        return np.asarray(v[..., 2] + (1.0 - self.law.along_at_rest))

    def dense(self, tensions: Array, poses: Array, strains: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4) at arc lengths s, a step from the nodes below."""
        step = np.clip(np.searchsorted(self.mesh.s, s, side="left") - 1, 0, self.mesh.steps - 1)
        of, active, left = (self.arm, self._statics), self.mesh.active[step], self.mesh.s[step]
        inside = nodes_of(self.scheme, left, s), np.repeat(active, len(self.scheme.nodes))
        known = StrainsByTensions.at(*of, *inside).known(tensions)
        across = mapped(built(_step, self._statics, self.scheme, self._statics.is_explicit))
        pose, _ = across(poses[step], *(each.reshape(s.size, -1) for each in known), s - left)
        there = reported(self.law, StrainsByTensions.at(*of, s, active)(tensions))
        at_node = (s == self.mesh.s[step + 1])[:, None]
        return np.where(at_node, poses[step + 1], pose), there
