"""Spacer discs: tendons that run straight between guides, as a rod term.

A tendon with guides at s_0 = 0 < s_1 < ... < s_n = l_i passes the points p_k = u(s_k) + R(s_k) Y_k,
where Y_k is its offset in the cross-section of guide k. Guides are rigid, and the tendon slides
through them. Under the tension T the tendon has the potential

    T l,    l = sum_k |p_{k+1} - p_k|.

With e = (p_{k+1} - p_k) / |p_{k+1} - p_k|, a span pulls guide k with the force T e at p_k, and
guide k + 1 with -T e at p_{k+1}. Moments and forces of the rod jump by these loads at the nodes of
the guides; between the guides the cross-sections carry M and F alone.

With Coulomb friction a guide turns the tendon by the angle between the spans on both sides, and the
capstan law gives the tension of span k, T exp(-direction mu theta_k), from the sum theta_k of the
angles between the base and the span. theta_k is a node variable of the guide at which the span
begins.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.explicit import ClosedForm
from octoplan.model.mesh import Counts, Mesh, stations, tendon_paths
from octoplan.model.paths import SAME, Array
from octoplan.model.rod.collocation import MAGNUS6
from octoplan.model.rod.element import zero
from octoplan.model.rod.equations import ParameterValues, PlacedKernel
from octoplan.model.rod.kernels import Kernel, Places
from octoplan.model.rod.rod_term import RodTerm
from octoplan.model.rod.structure import RodPlaces
from octoplan.model.rotations import POSE, matrices, norm, unit_matrix
from octoplan.model.scene import Scene
from octoplan.model.support.machine.functions import cached

# Refinement of the mesh of arms that are curved at rest: the error of lengths is rounding.
_REST_REFINEMENT = 32


@dataclass(frozen=True)
class GuideTerm(RodTerm):
    """The tendons of an arm that run straight between guides.

    Attributes
    ----------
    places : tuple of float
        Arc lengths of the guides of all tendons, from the base [m].
    spans : tuple of (int, int, int)
        Tendon, and the indices in `places` of both ends, of each straight span.
    signed_mu : tuple of float
        Direction mu of each tendon of the arm; () without friction.
    """

    places: tuple[float, ...]
    spans: tuple[tuple[int, int, int], ...]
    signed_mu: tuple[float, ...] = ()
    couples_sections = True
    depends_on_shape = True
    couples_nodes = True

    @classmethod
    def of(cls, arm: Arm, scene: Scene) -> GuideTerm:
        """Return the term of all tendons of an arm that have guides."""
        signed_mu = tuple[float, ...]()
        for term in scene.rod_terms:
            signed_mu += term.signed_friction(arm)
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
        return cls(tuple(places), tuple(spans), signed_mu)

    @property
    def n_node_variables(self) -> int:
        """The number of tendons with guides in a scene with friction, otherwise 0."""
        return len(self._tendons) if self.signed_mu else 0

    @property
    def _tendons(self) -> list[int]:
        """The tendons with guides."""
        return sorted({j for j, _, _ in self.spans})

    def structure(self) -> Hashable:
        """Return the spans, which are places of the kernels, and whether there is friction."""
        return self.spans, bool(self.signed_mu)

    def required_arc_lengths(self, arm: Arm) -> tuple[float, ...]:
        """Return the guides inside the arm."""
        return tuple(s for s in self.places if 0 < s < arm.length)

    def nodes(self, mesh: Mesh) -> tuple[int, ...]:
        """Return the nodes of the guides."""
        return tuple(mesh.node(s) for s in self.places)

    def node_kernels(self, places: RodPlaces) -> list[PlacedKernel]:
        """Return the pull of each span on its two guides."""
        tendon, first, last = self._spans_at(places.acting)
        ends = np.vstack([places.nodes[first, :POSE].T, places.nodes[last, :POSE].T])
        unknowns = np.vstack([tendon, places.n_before_states + ends])
        rows = np.vstack([places.nodes[first, POSE:].T, places.nodes[last, POSE:].T])
        if not self.signed_mu:
            return [PlacedKernel(cached(chord, False), unknowns, rows)]
        column = np.searchsorted(self._tendons, tendon[0])
        theta = places.variables[first, column]
        load = np.full_like(tendon, places.n_before_states - 1)
        unknowns = np.vstack([unknowns, load, places.n_before_states + theta])
        # Spans of one tendon are consecutive.
        after = np.flatnonzero(np.diff(tendon[0]) == 0) + 1
        guides = (first[after - 1], first[after], last[after])
        poses = np.vstack([places.nodes[each, :POSE].T for each in guides])
        bent = np.vstack([poses, theta[after - 1], theta[after]])
        at_guides = places.variables[list(places.acting)].ravel()
        none = np.setdiff1d(at_guides, theta[after])[None]
        return [
            PlacedKernel(cached(chord, True), unknowns, rows),
            PlacedKernel(bend(), places.n_before_states + bent, theta[after][None]),
            PlacedKernel(zero(), places.n_before_states + none, none),
        ]

    def length_kernels(self, places: RodPlaces) -> list[PlacedKernel]:
        """Return the lengths of the spans."""
        tendon, first, last = self._spans_at(places.acting)
        ends = np.vstack([places.nodes[first, :POSE].T, places.nodes[last, :POSE].T])
        return [PlacedKernel(cached(chord_length), places.n_before_states + ends, tendon)]

    def tension_factors(
        self, variables: Array, load_factor: float, mesh: Mesh, s: Array, tendon: Counts
    ) -> Array:
        """Return exp(-direction mu theta) of the spans; 1 for tendons without guides."""
        result = np.ones(s.size)
        if not self.signed_mu:
            return result
        nodes = self.nodes(mesh)
        for j, first, last in self.spans:
            theta = variables[nodes[first], self._tendons.index(j)]
            begin = self.places[first] if first else -1.0
            inside = (tendon == j) & (s > begin) & (s <= self.places[last] * (1 + SAME))
            result[inside] = np.exp(-load_factor * self.signed_mu[j] * theta)
        return result

    def kernel_values(self, arm: Arm, mesh: Mesh) -> ParameterValues:
        """Return the offsets of the spans."""
        offsets = self.offsets(arm)
        if not self.signed_mu:
            return {"chord": {"offsets": offsets}}
        tendon = np.array([j for j, _, _ in self.spans])
        after = np.flatnonzero(np.diff(tendon) == 0) + 1
        return {
            "chord": {"offsets": offsets, "signed_mu": np.array(self.signed_mu)[tendon][None]},
            "bend": {"offsets": np.vstack([offsets[:, after - 1], offsets[2:, after]])},
        }

    def length_values(self, arm: Arm, mesh: Mesh) -> ParameterValues:
        """Return the offsets of the spans."""
        return {"chord_length": {"offsets": self.offsets(arm)}}

    def span_nodes(self, mesh: Mesh) -> tuple[tuple[int, int, int], ...]:
        """Return the tendon and the nodes of both ends of each span."""
        at = self.nodes(mesh)
        return tuple((j, at[first], at[last]) for j, first, last in self.spans)

    def _spans_at(self, nodes: tuple[int, ...]) -> tuple[Places, Places, Places]:
        """Return the tendons (1, n) of the spans, and the nodes (n,) of both ends."""
        tendon, first, last = np.array(self.spans, np.int64).T
        at = np.array(nodes, np.int64)
        return tendon[None], at[first], at[last]

    def offsets(self, arm: Arm) -> Array:
        """Return the offsets along n and b (4, n) [m] at both ends of the spans."""
        tendon, first, last = np.array(self.spans, np.int64).T
        return np.vstack([guide_offsets(arm, self.places, i, tendon) for i in (first, last)])


def guide_offsets(arm: Arm, s: tuple[float, ...], place: Counts, tendon: Counts) -> Array:
    """Return the offsets along n and b (2, P) [m] of tendons at guides s[place]."""
    at = stations(arm, np.array(s), np.full(len(s), len(arm.sections)))
    return tendon_paths(arm, at, place, tendon)[:2]


def rest_lengths_of_spans(arm: Arm, lengths: Array) -> Array:
    """Return tendon lengths (n_tendons,) [m] with the rest lengths of tendons with guides.

    The length of a tendon with guides is the sum of its spans in the arm without tensions and
    loads. Other lengths are those given.
    """
    result = lengths.copy()
    for j, s in enumerate(arm.guides):
        if s is None:
            continue
        free = arm.with_continuous_guides
        at_rest = ClosedForm(free, Scene(), MAGNUS6, _REST_REFINEMENT, s)
        poses = at_rest.solve(np.zeros(arm.n_tendons)).poses
        nodes = [at_rest.mesh.node(each) for each in s]
        offsets = guide_offsets(arm, s, np.arange(len(s)), np.full(len(s), j))
        local = np.vstack([np.zeros(len(s)), offsets]).T[:, :, None]
        points = poses[nodes, 4:] + (matrices(poses[nodes, :4]) @ local)[:, :, 0]
        result[j] = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    return result


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


def chord(has_friction: bool) -> Kernel:
    """Return the kernel of the pull of a span on its guides.

    Unknowns: tension at the motor, poses of both guides; with friction also the load factor and the
    angle theta by which the tendon has turned. Rows: minus the moment and the force on the first
    guide and on the last guide.
    """
    span = _Span()
    T = ca.SX.sym("T")
    load = ca.SX.sym("load", int(has_friction))
    theta = ca.SX.sym("theta", int(has_friction))
    signed_mu = ca.SX.sym("signed_mu", int(has_friction))
    pull = T * ca.exp(-load * signed_mu * theta) if has_friction else T
    force = pull * span.along / ca.norm_2(span.along)
    first, last = span.levers
    rows = ca.vertcat(-ca.cross(first, force), -force, ca.cross(last, force), force)
    parameters = {"offsets": span.offsets}
    if has_friction:
        parameters["signed_mu"] = signed_mu
    return Kernel("chord", ca.vertcat(T, span.poses, load, theta), parameters, rows)


def bend() -> Kernel:
    """Return the kernel of the angle by which a guide turns a tendon.

    Unknowns: poses of the guide before, of the guide and of the guide beyond; theta of the span
    before and of the span beyond. Row: theta beyond minus theta before minus the angle.
    """
    poses = ca.SX.sym("g", 3 * POSE)
    offsets = ca.SX.sym("offsets", 6)
    theta = ca.SX.sym("theta", 2)
    points = [
        g[4:] + unit_matrix(g[:4]) @ ca.vertcat(0, Y)
        for g, Y in zip(ca.vertsplit(poses, POSE), ca.vertsplit(offsets, 2), strict=True)
    ]
    before, beyond = (b - a for a, b in pairwise(points))
    gap = norm(beyond / ca.norm_2(beyond) - before / ca.norm_2(before))
    angle = 2 * ca.asin(ca.fmin(gap / 2, 1))
    row = theta[1] - theta[0] - angle
    return Kernel("bend", ca.vertcat(poses, theta), {"offsets": offsets}, row)


def chord_energy() -> Kernel:
    """Return the kernel of tension times length of a span. Unknowns: poses of both guides."""
    span = _Span()
    tension = ca.SX.sym("tension")
    parameters = {"offsets": span.offsets, "tension": tension}
    return Kernel("chord_energy", span.poses, parameters, tension * ca.norm_2(span.along))


def chord_length() -> Kernel:
    """Return the kernel of the length of a span. Unknowns: poses of both guides."""
    span = _Span()
    length = ca.norm_2(span.along)
    return Kernel("chord_length", span.poses, {"offsets": span.offsets}, length)
