"""Spacer discs: tendons that run straight between guides, as a rod term.

A tendon with guides at s_0 = 0 < s_1 < ... < s_n = l_i passes the points p_k = u(s_k) + R(s_k) Y_k,
where Y_k is its offset in the cross-section of guide k. Guides are rigid, and the tendon slides
through them. Under the tension T the tendon has the potential

    T l,    l = sum_k |p_{k+1} - p_k|.

With e = (p_{k+1} - p_k) / |p_{k+1} - p_k|, a span pulls guide k with the force T e at p_k, and
guide k + 1 with -T e at p_{k+1}. Moments and forces of the rod jump by these loads at the nodes of
the guides; between the guides the cross-sections carry M and F alone.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.mesh import Mesh
from octoplan.model.paths import SAME, Array
from octoplan.model.rod.equations import ParameterValues, Term
from octoplan.model.rod.kernels import Kernel, Places
from octoplan.model.rod.nodes import POSE
from octoplan.model.rod.rod_term import RodPlaces, RodTerm
from octoplan.model.rotations import unit_matrix
from octoplan.model.stations import Counts, stations, tendon_paths
from octoplan.model.support.machine.functions import cached


@dataclass(frozen=True)
class GuideTerm(RodTerm):
    """The tendons of an arm that run straight between guides.

    Attributes
    ----------
    places : tuple of float
        Arc lengths of the guides of all tendons, from the base [m].
    spans : tuple of (int, int, int)
        Tendon, and the indices in `places` of both ends, of each straight span.
    """

    places: tuple[float, ...]
    spans: tuple[tuple[int, int, int], ...]
    couples_sections = True
    depends_on_shape = True
    couples_nodes = True

    @classmethod
    def of(cls, arm: Arm) -> GuideTerm:
        """Return the term of all tendons of an arm that have guides."""
        places = list[float]()
        for s in sorted({s for row in arm.guides if row is not None for s in row}):
            if not places or s - places[-1] > SAME * arm.length:
                places.append(s)
        spans = list[tuple[int, int, int]]()
        for j, row in enumerate(arm.guides):
            if row is None:
                continue
            at = np.abs(np.subtract.outer(row, places)).argmin(axis=1).tolist()
            spans += [(j, a, b) for a, b in pairwise(at)]
        return cls(tuple(places), tuple(spans))

    def structure(self) -> Hashable:
        """Return the spans, which are places of the kernels."""
        return self.spans

    def required_arc_lengths(self, arm: Arm) -> tuple[float, ...]:
        """Return the guides inside the arm."""
        return tuple(s for s in self.places if 0 < s < arm.length)

    def nodes(self, mesh: Mesh) -> tuple[int, ...]:
        """Return the nodes of the guides."""
        return tuple(mesh.node(s) for s in self.places)

    def node_kernels(self, places: RodPlaces) -> list[Term]:
        """Return the pull of each span on its two guides."""
        tendon, first, last = self._spans_at(places.acting)
        ends = np.vstack([places.nodes[first, :POSE].T, places.nodes[last, :POSE].T])
        unknowns = np.vstack([tendon, places.n_before_states + ends])
        rows = np.vstack([places.nodes[first, POSE:].T, places.nodes[last, POSE:].T])
        return [Term(cached(chord), unknowns, rows)]

    def length_kernels(self, places: RodPlaces) -> list[Term]:
        """Return the lengths of the spans."""
        tendon, first, last = self._spans_at(places.acting)
        ends = np.vstack([places.nodes[first, :POSE].T, places.nodes[last, :POSE].T])
        return [Term(cached(chord_length), places.n_before_states + ends, tendon)]

    def kernel_values(self, arm: Arm, mesh: Mesh) -> ParameterValues:
        """Return the offsets of the spans."""
        return {"chord": {"offsets": self._offsets(arm)}}

    def length_values(self, arm: Arm, mesh: Mesh) -> ParameterValues:
        """Return the offsets of the spans."""
        return {"chord_length": {"offsets": self._offsets(arm)}}

    def _spans_at(self, nodes: tuple[int, ...]) -> tuple[Places, Places, Places]:
        """Return the tendons (1, n) of the spans, and the nodes (n,) of both ends."""
        tendon, first, last = np.array(self.spans, np.int64).T
        at = np.array(nodes, np.int64)
        return tendon[None], at[first], at[last]

    def _offsets(self, arm: Arm) -> Array:
        """Return the offsets along n and b (4, n) [m] at both ends of the spans."""
        tendon, first, last = np.array(self.spans, np.int64).T
        return np.vstack([guide_offsets(arm, self.places, i, tendon) for i in (first, last)])


def guide_offsets(arm: Arm, s: tuple[float, ...], place: Counts, tendon: Counts) -> Array:
    """Return the offsets along n and b (2, P) [m] of tendons at guides s[place]."""
    at = stations(arm, np.array(s), np.full(len(s), len(arm.sections)))
    return tendon_paths(arm, at, place, tendon)[:2]


class _Span:
    """Symbols of a straight span: poses and offsets of both guides.

    Attributes
    ----------
    poses : (14,)
        Quaternion and position at both guides.
    offsets : (4,)
        Offsets along n and b at both guides [m].
    levers : list of (3,)
        From the midline to the tendon at both guides, in the base frame [m].
    along : (3,)
        From the first guide to the last one, along the tendon [m].
    """

    def __init__(self) -> None:
        self.poses = ca.SX.sym("g", 2 * POSE)
        self.offsets = ca.SX.sym("offsets", 4)
        ends = ca.vertsplit(self.poses, POSE)
        pairs = zip(ends, ca.vertsplit(self.offsets, 2), strict=True)
        self.levers = [unit_matrix(g[:4]) @ ca.vertcat(0, Y) for g, Y in pairs]
        points = [g[4:] + lever for g, lever in zip(ends, self.levers, strict=True)]
        self.along = points[1] - points[0]


def chord() -> Kernel:
    """Return the kernel of the pull of a span on its guides.

    Unknowns: tension, poses of both guides. Rows: minus the moment and the force on the first guide
    and on the last guide.
    """
    span = _Span()
    T = ca.SX.sym("T")
    force = T * span.along / ca.norm_2(span.along)
    first, last = span.levers
    rows = ca.vertcat(-ca.cross(first, force), -force, ca.cross(last, force), force)
    return Kernel("chord", ca.vertcat(T, span.poses), {"offsets": span.offsets}, rows)


def chord_length() -> Kernel:
    """Return the kernel of the length of a span. Unknowns: poses of both guides."""
    span = _Span()
    length = ca.norm_2(span.along)
    return Kernel("chord_length", span.poses, {"offsets": span.offsets}, length)
