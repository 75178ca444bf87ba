"""Parameter values of the equations of a rod, for an arm and a scene on a mesh."""

from __future__ import annotations

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.sections import Sections
from octoplan.model.loads import dead_resultant
from octoplan.model.mesh import Mesh
from octoplan.model.rod.equations import ParameterValues
from octoplan.model.rod.layout import Layout
from octoplan.model.rod.nodes import node_kernel_name
from octoplan.model.rod.rod_term import RodPoints, RodTerm, Values
from octoplan.model.rod.structure import NodeGroup, parameter_name, section_terms
from octoplan.model.scene import Scene
from octoplan.model.stations import Counts, base_pose, stations, tendon_paths


def rod_parameters(
    arm: Arm,
    scene: Scene,
    mesh: Mesh,
    layout: Layout,
    sections: Sections,
    terms: tuple[RodTerm, ...],
    node_terms: list[list[RodTerm]],
) -> ParameterValues:
    """Return the parameter values of the equations of equilibrium.

    A parameter of the stages of an element contains the values of its stages one after the other.

    Parameters
    ----------
    sections : Sections
        The cross-sections at the stages.
    terms : tuple of RodTerm
        All terms of the rod.
    node_terms : list of list of RodTerm
        The terms of each node group.
    """
    structure = layout.structure
    points = RodPoints(arm, sections.stations, terms)
    h = np.diff(mesh.s)
    N = h.size
    m = structure.stages
    of_sections = section_values(points)
    result: ParameterValues = {
        "clamp": {"pose": base_pose(arm)[:, None]},
        "element": {"h": h[None], "force": np.zeros((0, N)), "moment": np.zeros((0, N))},
        "body": {"body": sections.body, **of_sections},
        "tendon": {"path": sections.paths},
    }
    if structure.has_moment:
        end = np.repeat(mesh.s[1:], m)
        dead = {"dead": dead_resultant(arm, scene, sections.s, end)} | of_sections
        uniform = {
            name: np.repeat(value[:, None], N, axis=1)
            for name, value in uniform_values(arm, section_terms(terms)).items()
        }
        result["element"] |= {"force": np.zeros((3, N)), "moment": np.zeros((3, N))}
        result["element"] |= _by_element(dead, N) | uniform
        result["tip"] = {"moment": np.zeros((3, 1))}
        for i, (group, members) in enumerate(zip(layout.node_groups, node_terms, strict=True)):
            result[node_kernel_name(i)] = _node_values(arm, mesh, group, members)
    else:
        result["element"]["dead"] = np.zeros((0, N))
    if structure.couples_stages:
        result["body"]["body_rate"] = sections.body_rates
        stage, tendon = layout.crossings
        values = {"path": sections.paths} | tendon_values(points, stage, tendon)
        result["tendon_in_element"] = _by_passage(values, layout)
        k, j = layout.kinks
        result["tendon_jump"] = {"h": np.stack([h[k], h[k + 1]])}
        for side, s in (("before", mesh.s[k + 1]), ("after", mesh.inside(k + 1, mesh.s[k + 1]))):
            ends = stations(arm, s, mesh.active[k + 1])
            path = tendon_paths(arm, ends, np.arange(k.size), j)
            result["tendon_jump"][f"path_{side}"] = path
        result["tendon_in_element"]["h"] = h[None, layout.passages[0]]
    for members in node_terms:
        for term in members:
            result |= term.kernel_values(arm, mesh)
    return result


def uniform_values(arm: Arm, terms: tuple[RodTerm, ...]) -> Values:
    """Return the values (size,) of the uniform parameters of all terms."""
    return {
        parameter_name(i, name): value
        for i, term in enumerate(terms)
        for name, value in term.uniform_values(arm).items()
    }


def section_values(points: RodPoints) -> Values:
    """Return the values (size, n) of the section parameters of all terms."""
    return {
        parameter_name(i, name): value
        for i, term in enumerate(section_terms(points.terms))
        for name, value in term.section_values(points).items()
    }


def tendon_values(points: RodPoints, place: Counts, tendon: Counts) -> Values:
    """Return the values (size, P) of the tendon parameters of all terms."""
    return {
        parameter_name(i, name): value
        for i, term in enumerate(section_terms(points.terms))
        for name, value in term.tendon_values(points, place, tendon).items()
    }


def _node_values(arm: Arm, mesh: Mesh, group: NodeGroup, members: list[RodTerm]) -> Values:
    """Return the values (size, n) of the node parameters of a group of terms."""
    values = [
        term.node_values(arm, mesh, np.array(nodes, np.int64))
        for term, nodes in zip(members, group.nodes, strict=True)
    ]
    names = group.structure.term.node_parameters
    return {name: np.hstack([each[name] for each in values]) for name in names}


def _by_element(values: Values, N: int) -> Values:
    """Return values (size, N m) as (m size, N): by stage the values of one element."""
    return {
        name: value.reshape(len(value), N, -1).transpose(2, 0, 1).reshape(-1, N)
        for name, value in values.items()
    }


def _by_passage(values: Values, layout: Layout) -> Values:
    """Return values (size, P) of crossings as (m size, P / m): by stage the values of a passage."""
    stage, tendon = layout.crossings
    m = layout.structure.stages
    k, j = layout.passages
    place = np.zeros((layout.elements * m, layout.n_tendons), np.int64)
    place[stage, tendon] = np.arange(stage.size)
    chosen = place[k[:, None] * m + np.arange(m), j[:, None]]
    return {
        name: value[:, chosen].transpose(2, 0, 1).reshape(m * len(value), k.size)
        for name, value in values.items()
    }
