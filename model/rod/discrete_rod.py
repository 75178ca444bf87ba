"""The equations of equilibrium of an arm in a scene on a mesh, with their parameters.

The states S are all unknowns except tensions and load factor; see octoplan.model.rod.layout.
"""

from __future__ import annotations

from copy import copy
from functools import lru_cache, partial
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csr_array

from octoplan.model.arm import Arm
from octoplan.model.cross_section.law import cross_section_of
from octoplan.model.cross_section.sections import Sections
from octoplan.model.loads import (
    dead_resultant,
    growth_rate,
    is_coupled,
    required_arc_lengths,
    rod_terms,
)
from octoplan.model.mesh import Mesh, base_pose, graded, kinks, stations, tendon_paths
from octoplan.model.paths import Array
from octoplan.model.rod.element import element, node_kernel_name
from octoplan.model.rod.equations import ParameterValues
from octoplan.model.rod.kernels import Places
from octoplan.model.rod.layout import Layout, layout
from octoplan.model.rod.rod_term import RodTerm, Values
from octoplan.model.rod.structure import (
    NodeGroup,
    RodPoints,
    RodStructure,
    TermStructure,
    group_node_terms,
    section_terms,
    section_values,
    tendon_values,
    uniform_values,
)
from octoplan.model.rotations import POSE, cross
from octoplan.model.scene import Scene
from octoplan.model.support.machine.compiled import kernel
from octoplan.model.support.machine.functions import BatchFunction, BufferedFunction, cached


class DiscreteRod:
    """The equations of an arm in a scene on a mesh.

    Attributes
    ----------
    mesh : Mesh
    layout : Layout
    p : (n_p,)
        Parameters of the equations; see `parameters`.
    length_p : (n,)
        Parameters of the tendons' lengths.
    s : (N stages,)
        Arc lengths of the stages [m].
    sections : Sections
        The cross-sections at the stages; crossings of tendons have the order of the layout.
    terms : tuple of RodTerm
        The terms of the rod, with their parameter values.
    section_terms : tuple of RodTerm
        The terms with expressions of cross-sections or tendons, in the order of the structure.
    is_nonsmooth : bool
        Whether a term has kinks in its equations.
    node_terms : list of list of RodTerm
        The terms of each node group of the layout.
    units : (strains,)
        Units of the strains: 1 / L of curvatures [1/m], 1 of others.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        mesh: Mesh,
        stages: int,
        loaded: bool = True,
        machine_code: bool = False,
        terms: tuple[RodTerm, ...] | None = None,
    ) -> None:
        self.arm = arm
        self.scene = scene
        self.mesh = mesh
        self.loaded = loaded
        self.terms = rod_terms(arm, scene) if terms is None else terms
        self.section_terms = section_terms(self.terms)
        self.is_nonsmooth = any(term.is_nonsmooth for term in self.terms)
        structure = RodStructure(
            law=cross_section_of(scene, arm.is_curved, twisted=loaded),
            stages=stages,
            has_moment=loaded,
            has_force=any(term.depends_on_shape for term in self.terms),
            term_structures=tuple(TermStructure(term) for term in self.section_terms),
            machine_code=machine_code,
        )
        anchorages = [mesh.node(section.at) for section in arm.sections]
        ends = tuple(
            anchorages[i] if guides is None else 0
            for (i, _), guides in zip(arm.tendons, arm.guides, strict=True)
        )
        groups, self.node_terms = group_node_terms(self.terms, mesh)
        self.layout = layout(structure, ends, mesh.elements, groups, kinks(arm, mesh))
        self.s, weights, active = mesh.points(stages)
        self.sections = Sections(arm, scene, structure.law, self.s, active, machine_code)
        curvatures = np.arange(structure.n_strains) < 2 + structure.law.torsion
        self.units = np.where(curvatures, 1 / arm.length, 1.0)
        self.p = self.layout.equations.vector(self._parameter_values())
        length_path = {"path": self.sections.paths, "weight": weights[None, self.sections.place]}
        length_values: ParameterValues = {"tendon_length": length_path}
        for term in self.terms:
            length_values |= term.length_values(arm, mesh)
        self.length_p = self.layout.lengths.vector(length_values)

    def _parameter_values(self) -> ParameterValues:
        """Return the parameter values of the equations of equilibrium.

        A parameter of the stages of an element contains the values of its stages one after the
        other.
        """
        mesh = self.mesh
        layout = self.layout
        structure = layout.structure
        sections = self.sections
        points = RodPoints(self.arm, sections.stations, self.terms)
        h = np.diff(mesh.s)
        N = h.size
        of_sections = section_values(points)
        result: ParameterValues = {
            "clamp": {"pose": base_pose(self.arm)[:, None]},
            "element": {"h": h[None], "force": np.zeros((0, N)), "moment": np.zeros((0, N))},
            "body": {"body": sections.body, **of_sections},
            "tendon": {"path": sections.paths},
        }
        if structure.has_moment:
            end = np.repeat(mesh.s[1:], structure.stages)
            dead = {"dead": dead_resultant(self.arm, self.scene, sections.s, end)} | of_sections
            uniform = {
                name: np.repeat(value[:, None], N, axis=1)
                for name, value in uniform_values(self.arm, self.section_terms).items()
            }
            result["element"] |= {"force": np.zeros((3, N)), "moment": np.zeros((3, N))}
            result["element"] |= _by_element(dead, N) | uniform
            result["tip"] = {"moment": np.zeros((3, 1))}
            for i, (group, members) in enumerate(
                zip(layout.node_groups, self.node_terms, strict=True)
            ):
                result[node_kernel_name(i)] = _node_values(self.arm, mesh, group, members)
        else:
            result["element"]["dead"] = np.zeros((0, N))
        if structure.couples_stages:
            result["body"]["body_rate"] = sections.body_rates
            stage, tendon = layout.crossings
            values = {"path": sections.paths} | tendon_values(points, stage, tendon)
            result["tendon_in_element"] = _by_passage(values, layout)
            result["tendon_in_element"]["h"] = h[None, layout.passages[0]]
            result["tendon_jump"] = self._jump_values()
        for members in self.node_terms:
            for term in members:
                result |= term.kernel_values(self.arm, mesh)
        return result

    def _jump_values(self) -> Values:
        """Return the parameter values of the jumps of tendon states."""
        mesh = self.mesh
        h = np.diff(mesh.s)
        k, j = self.layout.kinks
        result = {"h": np.stack([h[k], h[k + 1]])}
        for side, s in (("before", mesh.s[k + 1]), ("after", mesh.inside(k + 1, mesh.s[k + 1]))):
            ends = stations(self.arm, s, mesh.active[k + 1])
            result[f"path_{side}"] = tendon_paths(self.arm, ends, np.arange(k.size), j)
        return result

    def __reduce__(self) -> tuple[Any, ...]:
        structure = self.layout.structure
        options = structure.stages, self.loaded, structure.machine_code, self.terms
        return _restored, (self.arm, self.scene, self.mesh, *options, self.p)

    def __copy__(self) -> DiscreteRod:
        result = object.__new__(DiscreteRod)
        vars(result).update(vars(self), p=self.p.copy())
        return result

    def with_base(self, arm: Arm) -> DiscreteRod:
        """Return the equations of an arm that differs in the base alone, on the same mesh."""
        result = copy(self)
        result.arm = arm
        pose = base_pose(arm)
        # q and -q are the same rotation: keep the sign within half a turn of this base.
        if pose[:4] @ self.base[:4] < 0:
            pose[:4] *= -1
        result.p[self.layout.clamp] = pose
        return result

    def on_mesh(
        self,
        mesh: Mesh,
        scene: Scene | None = None,
        arm: Arm | None = None,
        terms: tuple[RodTerm, ...] | None = None,
    ) -> DiscreteRod:
        """Return the equations on another mesh, by default of the same scene and arm.

        The default of `terms` are the terms of the scene.
        """
        structure = self.layout.structure
        return DiscreteRod(
            arm or self.arm,
            self.scene if scene is None else scene,
            mesh,
            structure.stages,
            self.loaded,
            structure.machine_code,
            terms,
        )

    @property
    def parameters(self) -> ParameterValues:
        """Views of the parameters: kernel name -> parameter name -> values (size, N)."""
        return self.layout.equations.named(self.p)

    @property
    def base(self) -> Array:
        """The pose (7,) at which the base is clamped."""
        return self.p[self.layout.clamp]

    def x(self, tensions: Array, load: float, states: Array) -> Array:
        """Return all unknowns (..., n_x): tensions (..., n_tendons), load factor, states."""
        factor = [load] if tensions.ndim == 1 else np.full((len(tensions), 1), load)
        return np.concatenate([tensions, factor, states], axis=-1)

    def residual(self, x: Array) -> Array:
        """Return the residuals of equilibrium (..., n_states)."""
        return np.asarray(self.layout.equations.value(x, self.p))

    def lengths(self, x: Array) -> Array:
        """Return the length of each tendon (n_tendons,) [m]."""
        return np.asarray(self.layout.lengths.value(x, self.length_p))

    def length_jacobian(self, x: Array) -> Array:
        """Return the derivatives of the lengths against the states (n_tendons, n_states)."""
        layout = self.layout
        jacobian = layout.lengths.jacobian
        shape = (layout.n_tendons, layout.n_x + 1)
        whole = csr_array((jacobian(x, self.length_p), jacobian.triplet), shape)
        return np.asarray(whole.toarray()[:, layout.n_before_states : -1])

    def by_wrench(self, x: Array, node: int) -> Array:
        """Return the changes of the residuals (n_states, 6) by a dead wrench at a node."""
        change = self.wrench_parameters(node)
        values = [self.layout.equations.value(x, self.p + each) for each in change.T]
        return np.stack(values, axis=1) - self.residual(x)[:, None]

    def wrench_parameters(self, node: int) -> Array:
        """Return the changes of p by a dead force and moment at a node (n_p, 6).

        Force and moment are parameters of the elements on the base side of the node, and of the
        node at the tip.
        """
        change = np.zeros((self.p.size, 6))
        parameters = self.layout.equations.named(change)
        parameters["element"]["force"][:, :node, :3] = np.eye(3)[:, None]
        if node < self.mesh.elements:
            parameters["element"]["moment"][:, node - 1, 3:] = np.eye(3)
        else:
            parameters["tip"]["moment"][:, 0, 3:] = np.eye(3)
        return change

    def poses(self, states: Array) -> Array:
        """Return the poses at the nodes (N + 1, 7), from base to tip."""
        return states[self.layout.nodes[:, :POSE]]

    def wrenches_beyond(self, x: Array) -> Array:
        """Return moments and forces on the tip side of the nodes (N + 1, n_wrench)."""
        layout = self.layout
        states = x[layout.n_before_states :].copy()
        for term in layout.equations.terms:
            if term.kernel.name in layout.node_kernel_names:
                # Each wrench row has the index of the wrench state that it balances.
                np.add.at(states, term.rows, self.rows_of(term.kernel.name, x).T)
        return states[layout.nodes[:, POSE : POSE + layout.structure.n_wrench]]

    def rows_of(self, name: str, x: Array) -> Array:
        """Return the residuals (N, n_r) of all repetitions of the kernel of a name."""
        (term,) = [term for term in self.layout.equations.terms if term.kernel.name == name]
        c = self.p[self.layout.equations.slices[self.layout.equations.terms.index(term)]]
        c = c.reshape(term.count, -1)
        return cached(BatchFunction, term.kernel.value, self.layout.structure.machine_code)(
            x[term.unknowns].T, c
        )[0]

    def integrate_poses(self, strains: Array) -> Array:
        """Integrate strains at the stages (N stages, strains) to poses at the nodes (N + 1, 7)."""
        structure = self.layout.structure
        base = self.p[self.layout.clamp]
        kinematics = RodStructure(
            structure.law, structure.stages, has_moment=False, machine_code=structure.machine_code
        )
        (result,) = cached(_integrator, kinematics, self.mesh.elements)(
            base, strains.ravel(), np.diff(self.mesh.s)
        )
        return np.vstack([base, result])

    def initial_states(
        self,
        tensions: Array,
        strains: Array,
        load: float = 0.0,
        known: tuple[Places, Array] | None = None,
    ) -> Array:
        """Return initial states (..., n_states) from strains (..., N stages, strains).

        Poses are integrated from the base; forces and moments are integrated from the tip.

        Parameters
        ----------
        tensions : (..., n_tendons)
        load : float
            The load factor.
        known : (n,), (n,)
            Places and values of known node variables.
        """
        layout = self.layout
        structure = layout.structure
        batch = tensions.shape[:-1]
        x = self.x(tensions, load, np.zeros((*batch, layout.n_states)))
        states = x[..., layout.n_before_states :]
        states[..., layout.stages] = strains
        by_arm = strains.reshape(-1, *strains.shape[-2:])
        poses = np.array([self.integrate_poses(each) for each in by_arm])
        states[..., layout.nodes[:, :POSE]] = poses.reshape(*batch, *poses.shape[1:])
        h = np.diff(self.mesh.s)
        by_stage = strains.reshape(*batch, h.size, structure.stages, -1)
        for term, places in zip(self.section_terms, layout.stage_variables, strict=True):
            variables = term.initial_stage_variables(by_stage, h)
            states[..., places] = variables.reshape(*batch, *places.shape)
        for group, members, each in zip(
            layout.node_groups, self.node_terms, layout.node_variables, strict=True
        ):
            for term, nodes, places in zip(members, group.nodes, each, strict=True):
                states[..., places[list(nodes)]] = term.initial_node_variables(self.arm)
        if known is not None:
            states[..., known[0]] = known[1]
        if not structure.has_moment:
            return states
        missing = -self.residual(x)
        states[..., layout.tendon_states] = np.cumsum(missing[..., layout.tendon_states], axis=-3)
        moments = layout.nodes[:, POSE : POSE + 3]
        if structure.has_force:
            forces = layout.nodes[:, POSE + 3 : POSE + 6]
            states[..., forces] = _from_tip(missing[..., forces])
            # The residuals do not contain the forces beyond the elements.
            along = np.diff(states[..., layout.nodes[:, 4:POSE]], axis=-2)
            missing[..., moments[:-1]] += cross(along, states[..., forces[1:]])
        states[..., moments] = _from_tip(missing[..., moments])
        return states


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


def _from_tip(steps: Array) -> Array:
    """Return the sums (..., N + 1, 3) of the steps from the tip to each node."""
    return np.asarray(np.cumsum(steps[..., ::-1, :], axis=-2)[..., ::-1, :])


def _restored(*value: Any) -> DiscreteRod:
    """Return equations with the parameters p that are the last argument."""
    result = DiscreteRod(*value[:-1])
    result.p = value[-1]
    return result


@lru_cache(maxsize=32)
def system(
    arm: Arm,
    scene: Scene,
    stages: int,
    refinement: int,
    at: tuple[float, ...] = (),
    loaded: bool = True,
    machine_code: bool = False,
    steps_per_unit: float = 2.0,
) -> DiscreteRod:
    """Return the equations on a mesh of a refinement that has the arc lengths `at` as nodes.

    Without `loaded`, forces and moments are left out. With `machine_code`, the kernels are
    compiled. See octoplan.model.mesh.graded for `steps_per_unit`.
    """
    rate = partial(growth_rate, arm, scene) if is_coupled(arm, scene) else None
    nodes = *at, *required_arc_lengths(arm, scene)
    mesh = graded(arm, refinement, nodes, rate, steps_per_unit=steps_per_unit)
    return DiscreteRod(arm, scene, mesh, stages, loaded, machine_code)


def _integrator(structure: RodStructure, N: int) -> BufferedFunction:
    """Return (pose, strains of each of N elements, h (1, N)) -> pose at the end of each."""
    values = cached(element, structure)
    pose = ca.SX.sym("g", POSE)
    v = ca.SX.sym("v", structure.stages * structure.n_strains)
    h = ca.SX.sym("h")
    after = -values.value(ca.vertcat(pose, v, ca.SX.zeros(POSE)), h)[-POSE:]
    step = ca.Function("integrator", [pose, v, h], [after], {"cse": True})
    return BufferedFunction(kernel(step, structure.machine_code).mapaccum(N))
