"""Potential energy of an arm, and constraints of its lengths and gaps, as sums of kernels.

octoplan.model.extensions.lengths.least_energy solves the program with these functions. The unit of
lengths is the length of the arm; the unit of forces is the force that bends the arm.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from octoplan.model.cross_section.law import (
    STIFFNESS_SIZE,
    CrossSection,
    EnergySection,
    body_size,
    elastic_strains,
    size,
)
from octoplan.model.extensions.guides import chord_energy, chord_length
from octoplan.model.extensions.obstacles.base import SIZE, signed_distance
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.element import element, rotation_quaternions
from octoplan.model.rod.equations import Equations, PlacedKernel
from octoplan.model.rod.kernels import Intermediates, Kernel, Places
from octoplan.model.rod.layout import Layout
from octoplan.model.rod.structure import RodStructure
from octoplan.model.rod.tendons import tendon_length
from octoplan.model.rotations import POSE, unit_matrix
from octoplan.model.support.machine.functions import cached


def body_energy(law: EnergySection) -> Kernel:
    """Return the kernel of the energy of a stage minus the work of dead generalised forces.

    Unknowns: strains. Parameters: weight, the parameters of the body, minus the forces.
    """
    v = ca.SX.sym("v", size(law))
    weight = ca.SX.sym("weight")
    body = ca.SX.sym("body", body_size(law))
    forces = ca.SX.sym("forces", size(law))
    parameters = {"weight": weight, "body": body, "forces": forces}
    energy = law.energy(elastic_strains(law, v, body), body[:STIFFNESS_SIZE]) + ca.dot(forces, v)
    return Kernel("body_energy", v, parameters, weight * energy)


def dead_loads(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of minus the work of dead loads on an element, -integral of F . u'.

    Unknowns: q at the first node, strains. Parameters: h, the resultants of dead forces beyond the
    stages (3, m).
    """
    q = ca.SX.sym("q", 4)
    v = ca.SX.sym("v", size(law), m)
    h = ca.SX.sym("h")
    dead = ca.SX.sym("dead", 3, m)
    twists = [law.twist(strains) for strains in ca.horzsplit(v)]
    intermediates = Intermediates()
    quaternions = rotation_quaternions(intermediates, [kappa for kappa, _ in twists], h)[:-1]
    pairs = zip(quaternions, twists, strict=True)
    along = [unit_matrix(quaternion) @ nu for quaternion, (_, nu) in pairs]
    local = ca.horzsplit(unit_matrix(q).T @ dead)
    work = ca.vertcat(*(ca.dot(f, t) for f, t in zip(local, along, strict=True)))
    value = -h * ca.dot(ca.DM(gauss(m).b), work)
    y = ca.vertcat(q, ca.vec(v))
    return Kernel("dead_loads", y, {"h": h, "dead": dead}, value, intermediates)


def off_midline() -> Kernel:
    """Return the kernel of minus the work of a dead force off the midline.

    Unknowns: q. Parameters: offset, force.
    """
    q = ca.SX.sym("q", 4)
    offset = ca.SX.sym("offset", 3)
    force = ca.SX.sym("force", 3)
    work = ca.dot(unit_matrix(q) @ offset, force)
    return Kernel("off_midline", q, {"offset": offset, "force": force}, -work)


def kinematics(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of the kinematics of an element: the residuals of its last pose."""
    structure = RodStructure(law, m, has_moment=False)
    return cached(element, structure).part("kinematics", slice(-POSE, None))


def node_gap() -> Kernel:
    """Return the kernel of the gap at a node, in units of the length L of the arm.

    Unknowns: u / L. Parameters: those of the obstacle in metres, the radius of the arm over L, L.
    """
    u = ca.SX.sym("u", 3)
    c = ca.SX.sym("c", SIZE + 2)
    distance, _ = signed_distance()(c[SIZE + 1] * u, c[:SIZE])
    return Kernel("node_gap", u, {"values": c}, distance / c[SIZE + 1] - c[SIZE])


def stretched() -> Kernel:
    """Return the kernel of the energy of a tendon. Unknown: elongation. Parameter: stiffness."""
    e = ca.SX.sym("e")
    stiffness = ca.SX.sym("stiffness")
    return Kernel("stretched", e, {"stiffness": stiffness}, stiffness * e**2 / 2)


def longer() -> Kernel:
    """Return the kernel of minus the elongation of a tendon, for the row of its length."""
    e = ca.SX.sym("e")
    return Kernel("longer", e, {}, -e)


# Tendon, and the nodes of both ends, of each straight span.
Spans = tuple[tuple[int, int, int], ...]


def span_poses(layout: Layout, spans: Spans) -> Places:
    """Return the places (14, n) of the poses at both ends of straight spans."""
    _, first, last = np.array(spans, np.int64).reshape(-1, 3).T
    return np.vstack([layout.nodes[first].T, layout.nodes[last].T])


def potential_energy(layout: Layout, levers: tuple[int, ...], spans: Spans) -> Equations:
    """Return the energy as a function of the states and the elongations of the tendons.

    `levers` are the nodes at which dead forces act off the midline; `spans` belong to the tendons
    that run straight between guides.
    """
    law = layout.structure.law
    assert isinstance(law, EnergySection)
    n = layout.n_states
    v = layout.stages.T
    nodes = layout.nodes
    terms = [
        (body_energy(law), v),
        (cached(tendon_length, law), v[:, layout.crossings[0]]),
        (cached(chord_energy), span_poses(layout, spans)),
        (dead_loads(law, layout.structure.stages), np.vstack([nodes[:-1, :4].T, layout.inside])),
        (off_midline(), nodes[list(levers), :4].T),
        (stretched(), n + np.arange(layout.n_tendons)[None]),
    ]
    row = [PlacedKernel(kernel, y, np.zeros((1, y.shape[1]), np.int64)) for kernel, y in terms]
    return Equations(n + layout.n_tendons, 1, row)


def held_rows(layout: Layout, obstacles: int, spans: Spans) -> Equations:
    """Return the rows: poses at the ends of elements, lengths of tendons, gaps at nodes."""
    law = layout.structure.law
    nodes = layout.nodes
    stage, tendon = layout.crossings
    n = layout.n_states
    N = layout.elements
    n_tendons = layout.n_tendons
    tendons = np.arange(n_tendons)[None]
    poses = np.arange(POSE * N).reshape(N, POSE).T
    lengths = POSE * N + tendons
    gaps = POSE * N + n_tendons + np.arange(N * obstacles)[None]
    places = np.vstack([nodes[:-1].T, layout.inside, nodes[1:].T])
    terms = [
        PlacedKernel(kinematics(law, layout.structure.stages), places, poses),
        PlacedKernel(cached(tendon_length, law), layout.stages.T[:, stage], lengths[:, tendon]),
        PlacedKernel(
            cached(chord_length), span_poses(layout, spans), lengths[:, [j for j, _, _ in spans]]
        ),
        PlacedKernel(longer(), n + tendons, lengths),
        PlacedKernel(node_gap(), np.repeat(nodes[1:, 4:], obstacles, axis=0).T, gaps),
    ]
    return Equations(n + n_tendons, POSE * N + n_tendons + gaps.size, terms)
