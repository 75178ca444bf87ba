"""Instances: a program with the numbers of a planning problem.

A PlanningProblem is the question; a Program has symbols; a ProgramInstance joins both: the program
of the question's structure with numbers for all parameters, bounds and scales.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.equilibrium.newton import STAGES
from octoplan.model.equilibrium.stability import is_stable
from octoplan.model.loads import has_unique_equilibrium, is_coupled
from octoplan.model.paths import Array
from octoplan.model.rod.discrete_rod import DiscreteRod, system
from octoplan.model.settle import ACCURACY
from octoplan.model.support.errors import OctoplanError, SingularError
from octoplan.model.tendons import rest_lengths
from octoplan.planner.block import Block
from octoplan.planner.blocks import (
    LeastStretch,
    PeakTension,
    TendonLengths,
    TotalPull,
    equilibrium_parameters,
    equilibrium_scales,
)
from octoplan.planner.limits import NATURAL_RANGE, TendonLimits, effort_unit, natural_tensions
from octoplan.planner.planning_problem import NlpOptions, PlanningProblem
from octoplan.planner.program import Program, Structure, program_of
from octoplan.planner.targets.target_set import TargetRows

# Lower and upper bounds of unknowns, then of rows.
Bounds = tuple[Array, Array, Array, Array]
# Weight of the effort in least squares, during a search [-].
SEARCH_WEIGHT = 1e-7
# Weight of the effort in least squares, in the end [-]. Least squares with this weight stop short
# of a point within reach by RESOLVED at most. The weight is reduced in proportion to accuracies
# finer than ACCURACY. The smaller the weight, the less exactly the solver minimises the effort.
FINAL_WEIGHT = 3e-11
# Distance over L below which a nearest shape is not distinguished from a shape at the target.
RESOLVED = ACCURACY / 2
# Elements of a mesh per unit of bending, see octoplan.model.mesh.graded. Shapes are settled with
# 2; the error of the coarser mesh of a program is corrected (octoplan.planner.solve.refine).
STEPS_PER_UNIT = 1.2
# Largest upper bound of a tension that the solver receives, over the scale of the tension [-].
LARGEST_BOUND = 1e12
# Largest tension, over the tension that bends the arm by 1 rad, that has no effect within the
# tolerances of targets [-].
NO_EFFECT = 5e-7


class ProgramInstance:
    """A planning problem in scaled unknowns: a program with numbers.

    Attributes
    ----------
    problem : PlanningProblem
        Arm, scene, targets, limits and accuracy.
    options : NlpOptions
    limits : TendonLimits
        Limits of the tendons. Tendons that targets exclude are fixed at the minimum.
    target_set : TargetSet
    blocks : tuple of Block
        Blocks of the program, with their numbers; `extensions` are the given ones among these.
    program : Program
        Shared by all problems of the same structure.
    forward : CollocationMap
        The equations of equilibrium alone, on the same mesh.
    stretch : LeastStretch
        One of the blocks.
    unit : (n_tendons,)
        Scale of each tension [N].
    effort_unit : float
        Reference tension of the effort, T_ref [N].
    scale : (size,)
        Scale of each unknown.
    bounds : tuple of arrays
        Lower and upper bounds of the unknowns, then of the rows, all scaled.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        options: NlpOptions | None = None,
        blocks: Sequence[Block] = (),
    ) -> None:
        self.problem = problem
        self.arm = problem.arm
        self.scene = problem.scene
        self.target_set = problem.target_set
        self.limits = problem.allowed
        self.options = options or problem.options
        self.extensions = tuple(blocks)
        self.unit = tension_scales(problem.arm, problem.limits)
        self.effort_unit = self._effort_unit()
        stations = sorted({*self.target_set.stations, *(s for b in blocks for s in b.stations())})
        rod = self._rod(tuple(stations))
        self.forward = _forward(rod)
        self.stretch = _least_stretch(rod)
        self.blocks = (
            *([PeakTension()] if self.options.norm == "inf" else []),
            TargetRows.of(self.target_set, self.options.mode),
            *(problem.placement.blocks(self.options.norm) if problem.placement else ()),
            *blocks,
            self.stretch,
            *self._limited_blocks(rod),
        )
        nodes = tuple((s, rod.mesh.node(s)) for s in stations)
        options = self.options
        structure = Structure(rod.layout, nodes, options.norm, options.mode, self.blocks)
        self.program = program_of(structure)
        self._p = self._parameters(rod)
        self.scale = np.ones(self.program.size)
        self.scale[: self.unit.size] = self.unit
        self.scale[self.program.states.start :] = self._p[self.program.parts["scale"]]
        self.bounds = self._bounds()

    def _rod(self, stations: tuple[float, ...]) -> DiscreteRod:
        """Return the rod on the mesh of the options, with nodes at the stations."""
        problem = self.problem
        return system(
            problem.arm,
            problem.scene,
            STAGES,
            self.options.refinement,
            stations,
            is_coupled(problem.arm, problem.scene) or bool(self.target_set.requests),
            problem.machine_code,
            STEPS_PER_UNIT,
        )

    def _limited_blocks(self, rod: DiscreteRod) -> list[Block]:
        """Return the blocks of limits, responses and stability that the problem has."""
        limits, layout, arm = self.limits, rod.layout, self.arm
        blocks: list[Block] = []
        if limits.total is not None:
            blocks.append(TotalPull(limits.total))
        if self.target_set.requests:
            from octoplan.planner.linearised_blocks import Responses

            requests = zip(self.target_set.requests, self.target_set.directions, strict=True)
            blocks += [Responses(layout, each, D, arm.bending_force) for each, D in requests]
        if self.options.modes:
            from octoplan.planner.linearised_blocks import LeastMode

            blocks.append(LeastMode(layout, self.options.stability_bound))
        if limits.strokes is not None:
            zero = np.array(limits.stroke_zero or rest_lengths(arm))
            blocks.append(TendonLengths(layout, arm.length, zero, np.array(limits.strokes)))
        return blocks

    def _effort_unit(self) -> float:
        """Return the reference tension of the effort [N].

        If effort alone is the objective, and the tensions can satisfy all equalities, the reference
        changes no optimum; programs converge fastest with the scale of the tensions. Otherwise the
        reference does not depend on limits, because effort is weighed against other objectives.
        """
        terms = self.target_set.terms
        effort_alone = self.options.mode == "exact" and not terms.names[3]
        if effort_alone and terms.count <= self.problem.n_controls:
            return float(self.unit.max())
        return effort_unit(self.arm)

    def replace(self, **changes: Any) -> ProgramInstance:
        """Return the same problem with some options changed."""
        return ProgramInstance(self.problem, self.options.replace(**changes), self.extensions)

    def kernel_parameters(self, rod: DiscreteRod) -> Array:
        """Return the parameters of all kernels (n,), for a rod of the same layout."""
        values = equilibrium_parameters(rod)
        for block in self.blocks:
            values += [*block.share_parameters(rod), *block.kernel_parameters(rod)]
        return np.concatenate([np.ravel(each, "F") for each in values])

    def _parameters(self, rod: DiscreteRod) -> Array:
        """Return all parameters of the program, without a defect."""
        program, p = self.program, np.zeros(self.program.p.numel())
        state_scale, row_scale = _scales(program, rod)
        weight = FINAL_WEIGHT * min(self.problem.accuracy / ACCURACY, 1.0)
        values: dict[str, Array | float] = {
            "T_ref": self.effort_unit,
            "weight": weight,
            "unit": self.unit,
            "kernels": self.kernel_parameters(rod),
            "scale": state_scale,
            "row_scale": row_scale,
        }
        for name, value in values.items():
            p[program.parts[name]] = value
        for block, place in zip(self.blocks, program.parameters, strict=True):
            p[place] = block.parameters()
        return p

    def parameters(self, weight: float | None = None, defect: Array | None = None) -> Array:
        """Return the parameters of the program.

        Parameters
        ----------
        weight : float
            Weight of the effort in least squares; that of the end unless given.
        defect : (n,)
            Defect of the mesh, see octoplan.planner.solve.refine; zero unless given.
        """
        p = self._p.copy()
        if weight is not None:
            p[self.program.parts["weight"]] = weight
        if defect is not None:
            p[self.program.parts["defect"]] = defect
        return p

    def parameters_at(self, x: Array, p: Array) -> Array:
        """Return parameters p with updates from the unknowns x at which a solve starts."""
        program, result, values = self.program, p, x * self.scale
        for block, place in zip(self.blocks, program.dependents, strict=True):
            updates = block.kernel_updates(self.forward.system, values[place])
            if not updates:
                continue
            result = result.copy()
            kernels = program.equations.named(result[program.parts["kernels"]])
            for name, update in updates.items():
                for parameter, value in update.items():
                    kernels[name][parameter][:] = value
        return result

    def _bounds(self) -> Bounds:
        """Return lower and upper bounds of unknowns and rows."""
        unit, limits, program = self.unit, self.limits, self.program
        lower, upper = np.array(limits.lower), np.array(limits.upper)
        upper = np.where(_without_effect(self.arm, upper), lower, upper)
        # The solver regards larger bounds as infinite.
        upper = np.where(upper < LARGEST_BOUND * unit, upper, np.inf)
        unbounded = np.full(program.size - unit.size, np.inf)
        lbx = np.concatenate([lower / unit, -unbounded])
        ubx = np.concatenate([upper / unit, unbounded])
        lbx[program.n_decision] = ubx[program.n_decision] = 1.0
        lbg, ubg = program.lower.copy(), program.upper.copy()
        for block in self.blocks:
            for kind, (low, high) in block.bounds().items():
                lbg[program.row_kinds == kind] = low
                ubg[program.row_kinds == kind] = high
        return lbx, ubx, lbg, ubg

    def tensions(self, x: Array) -> Array:
        """Return the tensions in unknowns x, exactly within the limits [N]."""
        T = x[: self.arm.n_tendons] * self.unit
        return np.clip(T, self.limits.lower, self.limits.upper)

    @property
    def controls(self) -> Array:
        """The places of tensions and base joints among the unknowns (n,)."""
        placed = zip(self.blocks, self.program.decisions, strict=True)
        joints = [np.arange(at.start, at.stop) for block, at in placed if block.n_controls]
        return np.concatenate([np.arange(self.arm.n_tendons), *joints])

    def base_joints(self, x: Array) -> tuple[float, ...]:
        """Return the values of the base joints in unknowns x; empty for a fixed base."""
        placed = zip(self.blocks, self.program.decisions, strict=True)
        return tuple(value for block, at in placed for value in block.base_joints(x[at]))

    def forward_at(self, arm: Arm) -> CollocationMap:
        """Return the equations of equilibrium of an arm whose base may be elsewhere."""
        if arm == self.arm:
            return self.forward
        return CollocationMap(self.forward.system.with_base(arm))

    def guess(self, controls: Array, settled: bool = False) -> Array:
        """Return the unknowns for tensions (n_tendons,) [N], followed by base joints if any.

        Without joint values, the base is that of the arm. The states are the equilibrium without
        loads, which is no equilibrium under loads. With `settled`, or under strong loads, the
        states are the equilibrium on the path from rest that comes nearest to the tensions: strong
        loads move the arm too far for Newton's method. The guess is the straight arm if the
        tensions collapse a cross-section.
        """
        tensions, joints = np.split(controls, [self.arm.n_tendons])
        forward = self.forward
        if joints.size:
            forward = self.forward_at(self.problem.at_base(tuple(joints.tolist())).arm)
        strong = is_coupled(self.arm, self.scene) and not has_unique_equilibrium(
            self.arm, self.scene
        )
        with suppress(OctoplanError, np.linalg.LinAlgError):
            if strong or (settled and is_coupled(self.arm, self.scene)):
                with suppress(OctoplanError, np.linalg.LinAlgError):
                    point = forward.solve_towards(tensions)
                    limits = self.limits.lower, self.limits.upper
                    return self.complete(np.clip(point.tensions, *limits), point.states)
            return self.complete(tensions, forward.without_loads(tensions))
        return self.complete(tensions, forward.without_loads(np.zeros(self.arm.n_tendons)))

    def complete(
        self, tensions: Array, states: Array, kernel_parameters: Array | None = None
    ) -> Array:
        """Return all unknowns, given tensions (n_tendons,) [N] and states of the arm (n_states,).

        Dependents solve the equations of the blocks; slacks are the violations of the rows.
        Pass `kernel_parameters=` to replace the parameters of all kernels.
        """
        program, p = self.program, self._p.copy()
        if kernel_parameters is not None:
            p[program.parts["kernels"]] = kernel_parameters
        x = np.zeros(program.size)
        x[: tensions.size] = tensions / self.unit
        x[program.n_decision] = 1.0
        x[program.states] = states / self.scale[program.states]
        deciding = _not_empty(self.blocks, program.decisions)
        for block, place in deciding:
            x[place] = block.initial_decisions(tensions / self.effort_unit, states)
        placed = _not_empty(self.blocks, program.dependents)
        at = [np.arange(place.start, place.stop) for block, place in placed if block.is_linear]
        if at:
            linear = np.concatenate(at)
            _, _, g, J = program.evaluate(x, p)
            rows = program.n_design_rows + linear - program.states.start
            x[linear] = -factorised(J.tocsr()[rows].tocsc()[:, linear]).solve(g[rows])
        for block, place in placed:
            if not block.is_linear:
                x[place] = block.initial_dependents(self.linearised(x)) / self.scale[place]
        for block, place in deciding:
            kind, numbers = block.slack_rows()
            if numbers:
                rows = np.flatnonzero(program.row_kinds == kind)[numbers]
                x[place] = np.maximum(-program.evaluate(x, p)[2][rows], 0.0)
        return x

    def linearised(self, x: Array) -> Equilibrium:
        """Return the equations of equilibrium at the tensions and states in unknowns x."""
        rod, at = self.forward.system, self.program.states
        return Equilibrium(rod, rod.x(self.tensions(x), 1.0, x[at] * self.scale[at]))

    def measured(self, x: Array) -> Array:
        """Return the measurements on the mesh at unknowns x, see Program.measure."""
        return self.program.measure(x, self._p)[0].ravel()

    def is_stable(self, x: Array, margin: float = 0.0) -> bool:
        """Return whether the stability of the equilibrium in unknowns x is above a margin.

        Without loads every equilibrium is stable.
        """
        return not is_coupled(self.arm, self.scene) or is_stable(self.linearised(x), margin)


def _not_empty(blocks: Sequence[Block], places: Sequence[slice]) -> list[tuple[Block, slice]]:
    """Return the blocks that have unknowns, with the places of the unknowns."""
    pairs = zip(blocks, places, strict=True)
    return [(block, place) for block, place in pairs if place.stop > place.start]


def factorised(matrix: csc_array) -> SuperLU:
    """Return the factors of a square matrix; raise SingularError if the matrix is singular."""
    try:
        return splu(matrix)
    except RuntimeError as reason:
        raise SingularError("equilibrium is singular in its states: the arm buckles") from reason


@lru_cache(maxsize=32)
def tension_scales(arm: Arm, limits: TendonLimits) -> Array:
    """Return the scale of each tension [N]: the tension that bends the arm by some rad."""
    natural, upper = NATURAL_RANGE * natural_tensions(arm), np.array(limits.upper)
    result = np.where(_without_effect(arm, upper), natural, np.minimum(upper, natural))
    result.setflags(write=False)
    return result


def _without_effect(arm: Arm, upper: Array) -> Array:
    """Return which tendons have an upper limit without effect on the shape."""
    return np.asarray(upper <= NO_EFFECT * natural_tensions(arm))


@lru_cache(maxsize=24)
def _forward(rod: DiscreteRod) -> CollocationMap:
    """Return the equations of equilibrium, with the equilibrium under the loads if known."""
    return CollocationMap(rod)


@lru_cache(maxsize=24)
def _least_stretch(rod: DiscreteRod) -> LeastStretch:
    """Return the block of the least stretches of a rod."""
    return LeastStretch.of(rod)


@lru_cache(maxsize=24)
def _scales(program: Program, rod: DiscreteRod) -> tuple[Array, Array]:
    """Return the scales of states and dependents, and of the equations (n_equations,)."""
    each = [equilibrium_scales(rod), *(b.scales(rod) for b in program.structure.blocks)]
    unknowns, rows = zip(*each, strict=True)
    return np.concatenate(unknowns), np.concatenate(rows)
