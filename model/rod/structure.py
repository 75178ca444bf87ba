"""The structure of a rod: its law and its terms without parameters, and the parameters by term."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import CrossSection, size
from octoplan.model.mesh import Counts, Mesh, Stations
from octoplan.model.paths import Array
from octoplan.model.rod.kernels import Places
from octoplan.model.rod.rod_term import RodTerm, Sizes, Symbols, Values


@dataclass(frozen=True)
class TermStructure:
    """The expressions of a term: equal to another one if class and structure are equal.

    Use `term` for expressions only, never for parameter values.
    """

    term: RodTerm = field(compare=False)
    key: Hashable = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "key", (type(self.term), self.term.structure()))


@dataclass(frozen=True)
class RodStructure:
    """The law and the terms of a rod on which the kernels of its elements depend.

    Attributes
    ----------
    law : CrossSection
    stages : int
        Number m of Gauss stages of each element.
    has_moment, has_force : bool
        Whether moment and force are states of the nodes.
    term_structures : tuple of TermStructure
        The terms that extend the cross-sections, see `section_terms`.
    machine_code : bool
        Whether the kernels are compiled.
    """

    law: CrossSection
    stages: int
    has_moment: bool = True
    has_force: bool = False
    term_structures: tuple[TermStructure, ...] = ()
    machine_code: bool = False

    @cached_property
    def terms(self) -> tuple[RodTerm, ...]:
        """The terms that extend the cross-sections, for expressions only."""
        return tuple(each.term for each in self.term_structures)

    @cached_property
    def n_wrench(self) -> int:
        """Number of components of moment and force at a node."""
        return 3 * self.has_moment + 3 * self.has_force

    @cached_property
    def n_strains(self) -> int:
        """Number of strains of a cross-section."""
        return size(self.law)

    @cached_property
    def variable_slices(self) -> tuple[slice, ...]:
        """The stage variables of each term, among the variables of a stage (strains first)."""
        sizes = [term.n_stage_variables(self.law) for term in self.terms]
        return _consecutive(sizes, self.n_strains)

    @cached_property
    def n_stage(self) -> int:
        """Number of variables of a stage: strains and further variables."""
        return self.n_strains + sum(term.n_stage_variables(self.law) for term in self.terms)

    @cached_property
    def state_slices(self) -> tuple[slice, ...]:
        """The tendon states of each term, among all states of a tendon at a node."""
        return _consecutive([term.n_tendon_states for term in self.terms])

    @cached_property
    def n_tendon_states(self) -> int:
        """Number of states of a tendon at a node."""
        return sum(term.n_tendon_states for term in self.terms)

    @cached_property
    def couples_stages(self) -> bool:
        """Whether a tendon has states or stage variables, so that its kernel spans an element."""
        return self.n_tendon_states > 0 or self.n_stage > self.n_strains

    def symbols(self, kind: str, columns: int = 1, stage_variables: bool = False) -> Symbols:
        """Return symbols (size, columns) of the parameters of one kind, for all terms.

        `kind` is "uniform", "section" or "tendon". With `stage_variables`, terms without stage
        variables are left out.
        """
        return {
            parameter_name(i, name): ca.SX.sym(name, count, columns)
            for i, term in enumerate(self.terms)
            for name, count in term_sizes(term, kind).items()
            if term.n_stage_variables(self.law) or not stage_variables
        }

    def stacked(self, kind: str, values: Values, count: int) -> Array:
        """Return the values (size, count) of one kind as a matrix (count, n), see `symbols`."""
        names = (
            parameter_name(i, name)
            for i, term in enumerate(self.terms)
            for name in term_sizes(term, kind)
        )
        return np.vstack([np.zeros((0, count)), *(values[name] for name in names)]).T


def term_sizes(term: RodTerm, kind: str) -> Sizes:
    """Return the sizes of the parameters of one kind of a term."""
    sizes: Sizes = getattr(term, f"{kind}_parameters")
    return sizes


def parameter_name(i: int, name: str) -> str:
    """Return the name of a parameter of term i in the kernels of the rod."""
    return f"{name}_{i}"


def of_term(structure: RodStructure, i: int, symbols: Symbols, column: int = 0) -> Symbols:
    """Return the symbols of term i by the names that the term uses, at one stage."""
    result = Symbols()
    for kind in ("uniform", "section", "tendon"):
        for name in term_sizes(structure.terms[i], kind):
            symbol = symbols.get(parameter_name(i, name))
            if symbol is not None:
                result[name] = symbol if symbol.size2() == 1 else symbol[:, column]
    return result


def _consecutive(sizes: list[int], start: int = 0) -> tuple[slice, ...]:
    """Return consecutive slices of given sizes."""
    slices = list[slice]()
    for count in sizes:
        slices.append(slice(start, start + count))
        start += count
    return tuple(slices)


@dataclass(frozen=True, eq=False)
class RodPoints:
    """Cross-sections of an arm at which section and tendon parameters are evaluated.

    Attributes
    ----------
    arm : Arm
    stations : Stations
        Geometry of the n cross-sections.
    terms : tuple of RodTerm
        All terms of the rod.
    """

    arm: Arm
    stations: Stations
    terms: tuple[RodTerm, ...]

    @cached_property
    def dead_load(self) -> Array:
        """The dead loads (3, n) of all terms per unit reference length [N/m]."""
        result = np.zeros((3, self.stations.s.size))
        for term in self.terms:
            result += term.dead_load_per_length(self.arm, self.stations.s)
        return result


class RodPlaces(NamedTuple):
    """Places of the states of a rod of N elements, for the kernels of a term.

    Attributes
    ----------
    structure : RodStructure
    n_before_states : int
        Number of unknowns before the states.
    nodes : (N + 1, 7 + n_wrench)
        Pose, moment and force of the nodes.
    inside : (n, N)
        Stage variables of the elements.
    variables : (N + 1, n_node_variables)
        Node variables of the term.
    acting : tuple of int
        The nodes at which the term acts, see RodTerm.nodes.
    """

    structure: RodStructure
    n_before_states: int
    nodes: Places
    inside: Places
    variables: Places
    acting: tuple[int, ...]


# Members that extend cross-sections and tendons, not the nodes alone.
_SECTION_MEMBERS = (
    "load_per_length",
    "moment_per_length",
    "n_stage_variables",
    "tendon_state_rate",
    "tension_ratio",
)


def section_terms(terms: tuple[RodTerm, ...]) -> tuple[RodTerm, ...]:
    """Return the terms with expressions of cross-sections or tendons.

    The kernels of elements do not depend on other terms, such as many forces at nodes.
    """
    return tuple(
        term
        for term in terms
        if any(getattr(type(term), name) is not getattr(RodTerm, name) for name in _SECTION_MEMBERS)
    )


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


@dataclass(frozen=True)
class NodeGroup:
    """Terms with the same expressions at nodes.

    Attributes
    ----------
    structure : TermStructure
    nodes : tuple of tuple of int
        The nodes at which each term has forces, moments and free variables.
    """

    structure: TermStructure
    nodes: tuple[tuple[int, ...], ...]

    @property
    def n_variables(self) -> int:
        """The number of variables of one term at each node."""
        return self.structure.term.n_node_variables


def group_node_terms(
    terms: tuple[RodTerm, ...], mesh: Mesh
) -> tuple[tuple[NodeGroup, ...], list[list[RodTerm]]]:
    """Return the groups of the terms that act at nodes of a mesh, and the terms of each group."""
    members: dict[TermStructure, list[RodTerm]] = {}
    for term in terms:
        if term.n_node_variables or term.nodes(mesh):
            members.setdefault(TermStructure(term), []).append(term)
    groups = tuple(
        NodeGroup(structure, tuple(term.nodes(mesh) for term in each))
        for structure, each in members.items()
    )
    return groups, list(members.values())
