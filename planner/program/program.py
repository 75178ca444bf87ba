"""The nonlinear program of a structure, in scaled unknowns; numbers are its parameters.

    minimise    what the mode says            subject to  lower <= tensions <= upper
                                                          inequalities >= 0, total pull <= limit
                                                          1 + q >= least stretch
                                                          the equations of all blocks

The unknowns are the tensions, what the norm and the inequalities add, the load factor, which is 1,
then those of each block, see octoplan.planner.program.blocks: which there are is decided by scene,
targets and limits.

Targets have equalities and soft residuals, which are to be 0 as well as the limits allow. The modes
are three readings of them, tried in this order:

    exact      equalities = 0 and soft residuals = 0; effort is made least
    closest    equalities = 0; soft residuals, and slacks of inequalities of low priority, are made
               least, with a regularisation weight on effort
    nearest    equalities, soft residuals and slacks of all inequalities are made least, those of
               high priority first
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu

from octoplan.model.paths import Array
from octoplan.model.rod.equations import Equations
from octoplan.model.rod.layout import POSE
from octoplan.model.rod.system import DiscreteRod
from octoplan.model.support.errors import SingularError
from octoplan.model.support.machine.functions import BufferedFunction
from octoplan.planner.nlp_options import NlpOptions
from octoplan.planner.program.blocks import Block, LeastMode, Responses, States, TendonLengths
from octoplan.planner.program.terms import HIGH_PRIORITY, LOW_PRIORITY, TargetStructure

STABILITY, STROKES, STRETCH = "stability", "strokes", "stretch"
PLANNED_STRETCH = 1e-3


def factorised(matrix: csc_array) -> SuperLU:
    """Return the factors of a square matrix; raises SingularError where it has none."""
    try:
        return splu(matrix)
    except RuntimeError as reason:
        raise SingularError("equilibrium is singular in its states: the arm buckles") from reason


@dataclass(frozen=True)
class Structure:
    """What a program depends on besides its parameters: all that enters its construction.

    Attributes
    ----------
    targets : TargetStructure
    options : NlpOptions
        Its margin and floor do not count.
    has_total, has_strokes : bool
        Whether there are limits of the total pull and of strokes.
    base : (7,)
        Pose of the base.
    length : float
        Of the arm [m].
    states : States
    """

    targets: TargetStructure
    options: NlpOptions
    has_total: bool
    has_strokes: bool
    base: tuple[float, ...]
    length: float
    states: States


class Program:
    """The program of a structure with the states as unknowns: multiple shooting, all in one.

    Unknowns are scaled. In CasADi symbols, as its solvers take it, and as functions of numbers.

    Attributes
    ----------
    size, n_free, n_slack : int
        How many unknowns there are, how many come before the load factor, and how many of these,
        the last, are slacks.
    n_equations : int
        How many equations of the blocks there are; they come last.
    parts : dict of slice
        Where the parts of the parameters are: numbers of the `targets`; `gaps`, of what keeps the
        arm clear; `weights`, reference tension, limit of the total pull and weight of effort;
        `unit`, what one unit of each tension is worth [N]; `force` of the responses; `numbers` of
        the equations; `scale` and `row_scale`, what one unit of each unknown of the blocks, and of
        each equation, is worth; `defect`, by how much what is measured on the mesh is off, see
        octoplan.planner.solve.refine.
    rows : (n_rows,) of str
        What kind of constraint each row is; `lower` and `upper` are their bounds.
    n_equalities : int
        How many rows, the first, are equalities of the targets.
    slack_rows : list of int
        The rows of the inequalities with a slack.
    states, responses, modes, lengths
        The blocks; `places` are the slices of their unknowns, `linear` the places of the unknowns
        of responses and lengths, in which their equations are linear.
    terms : TargetTerms
        Of all targets but those that keep the arm clear.
    measured : tuple of int
        How many numbers are measured: of poses, least stretches, compliances, eigenvalues, lengths.
    x, p : casadi.MX
        Unknowns and parameters.
    n_outer : int
        How many constraints there are besides the equations.
    outer, function : casadi.Function
        x, p, weights of the objective and of constraints -> objective (1,), its gradient,
        constraints, their Jacobian, the upper half of the Hessian of the weighted sum. Constraints
        are those besides the equations of `outer`, all of `function`.
    measure : BufferedFunction
        x, p -> what is measured on the mesh.
    """

    def __init__(self, structure: Structure) -> None:
        targets, states = structure.targets, structure.states
        of, self.terms = states.layout, targets.terms
        self._number(structure)
        gaps = targets.avoidance.gaps(targets.stations) if targets.avoidance else None
        _, numbers, compliances = map(self.terms.function.numel_in, range(3))
        modes, wound = len(self.modes), of.n_tendons * len(self.lengths)
        poses, stretches = POSE * len(states.nodes), len(states.slim)
        self.measured = poses, stretches, compliances, modes, wound
        sizes = {
            "targets": numbers,
            "gaps": gaps.n_p if gaps else 0,
            "weights": 3,
            "unit": of.n_tendons,
            "force": 1,
            "numbers": self.equations.n_p,
            "scale": self.n_equations,
            "row_scale": self.n_equations,
            "defect": sum(self.measured),
        }
        ends = list(accumulate(sizes.values(), initial=0))
        self.parts = dict(zip(sizes, map(slice, ends, ends[1:]), strict=False))
        self.x, self.p = ca.MX.sym("x", self.size), ca.MX.sym("p", ends[-1])
        self._differentiate(*self._state(structure, gaps))

    def _number(self, structure: Structure) -> None:
        """Number the unknowns, block by block, and state the equations of the blocks."""
        states, options = structure.states, structure.options
        of, requests, self.states = states.layout, self.terms.requests, states
        # Inequalities have no slack, or those of low priority do, or all.
        kept = {"exact": (), "closest": (LOW_PRIORITY,), "nearest": (LOW_PRIORITY, HIGH_PRIORITY)}
        has_slack = np.isin(self.terms.inequality_weights, kept[options.mode])
        self._soft = np.flatnonzero(has_slack).tolist()
        self.n_slack = len(self._soft)
        self.n_free = of.n_tendons + (options.norm == "inf") + self.n_slack
        firsts = accumulate((request.width for request in requests), initial=0)
        pairs = zip(requests, firsts, strict=False)
        self.responses = [Responses(states, request, first) for request, first in pairs]
        self.modes = [LeastMode(states) for _ in range(options.modes)]
        self.lengths = [TendonLengths(of)] * structure.has_strokes
        blocks: list[Block] = [states, *self.responses, *self.modes, *self.lengths]
        first = self.n_free + 1
        ends = list(accumulate((block.size for block in blocks), initial=first))
        slices = [slice(a, b) for a, b in pairwise(ends)]
        self.places = dict(zip(blocks, slices, strict=True))
        linear: list[Block] = [*self.responses, *self.lengths]
        at = [np.r_[self.places[block]] for block in linear]
        self.linear = np.concatenate([np.zeros(0, np.int64), *at])
        self.size, self.n_equations = ends[-1], ends[-1] - first
        before = np.r_[: of.n_tendons, first - 1 : first + of.n_states]
        terms = [
            term
            for block, at in self.places.items()
            for term in block.terms(before, at.start, at.start - first)
        ]
        self.equations = Equations(self.size, self.n_equations, terms, of.form.machine_code)

    def _state(self, structure: Structure, gaps: Equations | None) -> tuple[ca.MX, ca.MX]:
        """Return the objective and the constraints besides the equations; state bounds of all."""
        options = structure.options
        x, p, parts, terms, mode = self.x, self.p, self.parts, self.terms, options.mode
        measured, none = self._what_is_measured(), ca.MX(0, 1)
        self.measure = BufferedFunction(ca.Function("measured", [x, p], [ca.densify(measured)]))
        ends = np.cumsum([0, *self.measured]).tolist()
        of_settled = ca.vertsplit(measured + p[parts["defect"]], ends)
        poses, stretches, compliances, modes, lengths = of_settled
        whole = ca.vertcat(ca.DM(structure.base), poses)
        clear = gaps.value.function(whole, p[parts["gaps"]]) / structure.length if gaps else none
        seen = ca.reshape(poses, POSE, -1)[:, list(structure.targets.seen)]
        met, missed, inequality, least = terms.function(seen, p[parts["targets"]], compliances)
        cuts = [0, self.states.layout.n_tendons, self.n_free - self.n_slack, self.n_free]
        tensions, peak, slacks = ca.vertsplit(x[: self.n_free], cuts)
        soft, weights = self._soft, ca.DM(terms.inequality_weights[self._soft])
        inequality += ca.DM.eye(inequality.numel())[:, soft] @ slacks
        if mode == "nearest":
            slacks = ca.vertcat(ca.DM(terms.equality_weights) * met, weights * slacks)
        reference, total, weight = ca.vertsplit(p[parts["weights"]])
        pull = tensions * p[parts["unit"]] / reference
        effort = {"2": ca.sumsqr(pull) / 2, "1": ca.sum1(pull), "inf": peak}[options.norm]
        aim = ca.sum1(least) + weight * effort if least.numel() else effort
        missing = ca.sumsqr(ca.vertcat(missed, slacks)) / 2 + weight * aim
        equality = {"exact": ca.vertcat(met, missed), "closest": met, "nearest": none}[mode]
        left = total / reference - ca.sum1(pull)
        # Of a scalar less a vector CasADi loses derivatives by the scalar.
        peaks = ca.repmat(peak, pull.numel(), 1)
        constraints = (
            ("equality", equality, 0.0, 0.0),
            ("inequality", inequality, 0.0, np.inf),
            ("clear", clear, 0.0, np.inf),
            (STRETCH, stretches, PLANNED_STRETCH, np.inf),
            ("total pull", left if structure.has_total else none, 0.0, np.inf),
            ("peak", peaks - pull if peak.numel() else none, 0.0, np.inf),
            (STABILITY, modes, 0.0, np.inf),
            (STROKES, lengths, -np.inf, np.inf),
            ("equilibrium", ca.MX(self.n_equations, 1), 0.0, 0.0),
        )
        names, values, *ends = zip(*constraints, strict=True)
        sizes = [value.numel() for value in values]
        self.rows, self.lower, self.upper = (np.repeat(each, sizes) for each in (names, *ends))
        self.n_equalities = sizes[0]
        self.slack_rows = [sizes[0] + row for row in soft]
        return aim if mode == "exact" else missing, ca.vertcat(*values[:-1])

    def _what_is_measured(self) -> ca.MX:
        """Return what is measured, one below the other: see `measured`."""
        scaled = self.x * self.scale(self.p)
        values = {block: scaled[at] for block, at in self.places.items()}
        directions = self.terms.directions.call([self.p[self.parts["targets"]]])
        states = values[self.states]
        measured = [ca.vec(self.states.poses(states)), self.states.stretches(states)]
        for responses, D in zip(self.responses, directions, strict=True):
            displaced = responses.displaced(values[responses])
            measured.append(ca.vec(D.T @ displaced / self.p[self.parts["force"]]))
        measured += [self.x[self.places[mode]][-1] for mode in self.modes]
        return ca.vertcat(*measured, *(self.x[self.places[lengths]] for lengths in self.lengths))

    def _differentiate(self, f: ca.MX, outer: ca.MX) -> None:
        """Put the constraints together, and the derivatives: the blocks' come from kernels."""
        x, p, m = self.x, self.p, outer.numel()
        self.n_outer = m
        sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", m)
        hessian = ca.triu(ca.hessian(sigma * f + ca.dot(lam, outer), x)[0])
        first = [f, ca.densify(ca.gradient(f, x)), outer, ca.jacobian(outer, x)]
        self.outer = ca.Function("outer", [x, p, sigma, lam], [*first, hessian])
        lam = ca.MX.sym("lam", m + self.n_equations)
        f, gradient, outer, J, H = self.outer.call([x, p, sigma, lam[:m]], True, False)
        row_scale, numbers = (p[self.parts[name]] for name in ("row_scale", "numbers"))
        scale = self.scale(p)
        g = ca.vertcat(outer, self.equations.value.function(x * scale, numbers) / row_scale)
        of, places = self.equations.jacobian, self.equations.jacobian.places
        row, column = places.row(), places.get_col()
        nonzeros = of.function(x * scale, numbers) * ca.vertcat(scale, 1)[column] / row_scale[row]
        # With derivatives come values, which by themselves take less.
        by_x, g_too = ca.horzsplit(ca.MX(places, nonzeros), [0, x.numel(), x.numel() + 1])
        J, g_too = ca.vertcat(J, by_x), ca.vertcat(outer, g_too)
        of, places = self.equations.hessian, self.equations.hessian.places
        row, column = places.row(), places.get_col()
        nonzeros = of.function(x * scale, numbers, lam[m:] / row_scale)
        H += ca.triu(ca.MX(places, nonzeros * scale[column] * scale[row]))
        self.function = ca.Function("program", [x, p, sigma, lam], [f, gradient, g, J, H])
        values = list(map(ca.densify, (f, gradient, g_too, J.nz[:])))
        self._evaluated = BufferedFunction(ca.Function("program", [x, p], values))
        self._nonzeros = np.array(J.row(), np.int32), np.array(J.sparsity().colind(), np.int32)

    def scale(self, p: Any) -> Any:
        """Return what one unit of each unknown is worth (size,), of parameters."""
        unit, scale = (p[self.parts[name]] for name in ("unit", "scale"))
        return ca.vertcat(unit, ca.DM.ones(self.n_free - self.states.layout.n_tendons + 1), scale)

    def numbers(self, at: DiscreteRod, forces: Array) -> Array:
        """Return the numbers of the equations of an arm, by the forces (3, k) of responses [N]."""
        each = (number for block in self.places for number in block.numbers(at, forces))
        return np.concatenate([np.ravel(number, "F") for number in each])

    def scales(self, at: DiscreteRod) -> tuple[Array, Array]:
        """Return what one unit of each unknown of the blocks, and each equation, is worth."""
        unknowns, rows = zip(*(block.scales(at) for block in self.places), strict=True)
        return np.concatenate(unknowns), np.concatenate(rows)

    def evaluate(self, x: Array, p: Array) -> tuple[Array, Array, Array, csc_array]:
        """Return objective (1,), its gradient, constraints and their Jacobian at unknowns x.

        The rows of equilibrium come last.
        """
        f, gradient, g, nonzeros = (value.ravel() for value in self._evaluated(x, p))
        return f, gradient, g, csc_array((nonzeros, *self._nonzeros), shape=(g.size, x.size))
