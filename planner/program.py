"""Tension allocation as a nonlinear program in arc length, solved by ipopt.

The program states a boundary value problem by multiple shooting: node states are unknowns, segments
end at anchorages, and jump conditions add the loads at nodes. Inside each element, the equations
are Gauss collocation. Tensions, and base joints if any, are the controls.

    min  1/2 sum_j (T_j / T_ref)^2      over  T, a, S, d  with  S = (R, u, M, F, v, y, n)

    subject to  (R_0, u_0) = clamp,  y_0 = 0                          base condition
                (R, u)_{k+1} = Phi(R_k, u_k, v_k)                     kinematics of element k
                (M, F)_k = (M, F)_{k+1} + loads of element and node   balance, from tip to base
                0 = G(R_k, v_k, M_{k+1}, F_{k+1}, T, y_k)             stage equations of element k
                y_{k+1} = y_k + change over element k + jump          tendon states, with friction
                (M, F)_N = shape-dependent load and moment at the tip tip condition
                blocks(T, S, d) = 0                                   equations of the dependents d
                target(R, u at its stations + defect) = 0,
                soft residuals = 0,  target inequalities >= 0         target rows
                l <= rows of blocks(T, a, measured + defect) <= u     limits, such as 1 + q >= 1e-3
                T_min <= T <= T_max                                   bounds

R_k, u_k are the frame and the position of node k, v_k the strains at the Gauss stages of element k
(with friction also their derivatives), y_k the angles by which tendons have turned, and n the node
variables of contact. The defect is the error of the mesh (octoplan.planner.solve.refine). M_k, F_k
are the moment and the force that the loads beyond node k and at node k exert; the force omits dead
loads, whose resultant at each stage is a known number. 1 + q >= 1e-3 is one row for each segment,
at the thinnest place of its body, in scenes with extension. The program eliminates no
unknown; octoplan.planner.solve.reduced_program eliminates the states under strong loads.

The rod (octoplan.model.rod) places kernels whose residuals are added: a row may be the sum of
several kernels. `element_equations` adds the rows of Phi, the balance of an element, and in the
stage rows minus the local wrench; `stage_equations` adds body and tendons to the stage rows;
`jumps` adds the loads at a node to the balance of the node.

Blocks (octoplan.planner.block) add unknowns and rows: decisions a, such as slacks, and dependents d
with as many equations, such as tendon lengths or the least stable mode. Decisions may have shares
in the equations of the rod: base joints move the clamp (octoplan.planner.extensions.base_joints).
The objective f depends on the mode of the targets (octoplan.planner.targets.target_set). Let

    effort = 1/2 sum_j (T_j / T_ref)^2,  sum_j T_j / T_ref,  or  max_j T_j / T_ref  (norm 2, 1, inf)
             + cost of base joints
    cost   = effort, or sum of the targets' objectives + weight effort if targets have objectives

    exact      f = cost,                              equalities and soft residuals as rows
    closest    f = 1/2 |misses|^2 + weight cost,      equalities as rows
    nearest    f = 1/2 |misses|^2 + weight cost,      equalities among the misses

ipopt receives the unknowns w = (T, a, 1, S, d) / scale, with the load factor 1 between decisions
and states; the rows g = (c, r / row_scale), design rows c (targets and limits) before the equations
r of equilibrium and blocks; and

    df/dw,    dg/dw = (dc/dw, D_row^-1 dr/dx D),
    d2/dw2 (sigma f + lambda_c . c) + D (sum_i lambda_i / row_scale_i d2r_i/dx2) D,

with D = diag(scale), D_row = diag(row_scale) and x = D w: tensions, states and dependents in SI
units, decisions in units of their block. The design rows are not divided by scales. ipopt receives
the upper triangle of the Hessian. octoplan.model.rod.equations sums dr/dx and d2r/dx2 from
derivatives of small kernels. The target equalities c_E(w) = 0, a part of c, are relaxed to

    min  f(w) + 1/2 |e|^2    subject to  c_E(w) = epsilon (e - e_0),

so that multipliers e / epsilon are bounded if equalities depend on each other. c_E is epsilon^2
times the difference of the multipliers from the multipliers in e_0. Source: Rockafellar, "Augmented
Lagrangians and applications of the proximal point algorithm", Math. Oper. Res. 1 (1976).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, diags_array

from octoplan.model.paths import Array
from octoplan.model.rod.equations import Equations, PlacedKernel
from octoplan.model.rod.layout import Layout
from octoplan.model.rotations import POSE
from octoplan.model.support.machine.functions import BufferedFunction
from octoplan.planner.block import Block, ProgramView, Rows
from octoplan.planner.targets.target_set import EQUALITY

# Kind of the rows of equilibrium, and of the equations of blocks.
EQUILIBRIUM = "equilibrium"
Index = NDArray[np.int32]


@dataclass(frozen=True)
class Structure:
    """All values that enter the construction of a program.

    Attributes
    ----------
    rod : Layout
        Unknowns and placed kernels of the rod.
    stations : dict of int, as pairs
        Arc length [m] and node of each station.
    norm : "2", "1" or "inf"
        Norm of the tensions that is the effort; "inf" requires PeakTension among the blocks.
    mode : "exact", "closest" or "nearest"
    blocks : tuple of Block
    """

    rod: Layout
    stations: tuple[tuple[float, int], ...]
    norm: str
    mode: str
    blocks: tuple[Block, ...]


class Nlp(NamedTuple):
    """A nonlinear program in CasADi symbols.

    Attributes
    ----------
    w, p, sigma, lam : symbols
        Unknowns, parameters, and multipliers of objective and rows in the Hessian.
    f, gradient, g, jacobian, hessian
        Objective, rows, and derivatives; the upper triangle of the Hessian of the Lagrangian.
    """

    w: ca.MX
    p: ca.MX
    sigma: ca.MX
    lam: ca.MX
    f: ca.MX
    gradient: ca.MX
    g: ca.MX
    jacobian: ca.MX
    hessian: ca.MX


class Program:
    """The program of a structure: symbols and functions, without numbers.

    Attributes
    ----------
    structure : Structure
    size : int
        Number of unknowns.
    n_decision : int
        Number of tensions and decisions of blocks, the unknowns before the load factor.
    n_equations : int
        Number of equations of equilibrium and blocks, which are the last rows.
    decisions, dependents, measured, parameters : list of slice
        Places of each block among the unknowns, measurements and parameters.
    states : slice
        Place of the rod's states among the unknowns.
    parts : dict of slice
        Places of parameters: reference tension "T_ref" [N], "weight" of the effort, "unit", the
        scales of the tensions [N], parameters of the "kernels", "scale" and "row_scale" of states
        and dependents and their equations, "defect" of the measurements.
    equations : Equations
        Equilibrium and the equations of blocks, in SI units.
    row_kinds : (n_rows,) of str
        Kind of each row; `lower` and `upper` are its bounds unless a block has others.
    equality_rows : (n,) of int
        Rows of the target equalities.
    n_design_rows : int
        Number of rows before the equations.
    design, function : casadi.Function
        w, p, sigma, lambda -> objective (1,), gradient, rows, Jacobian, upper Hessian of the
        Lagrangian; `design` with the design rows alone.
    measure : BufferedFunction
        w, p -> poses at the stations, then the measurements of the blocks, without defect.
    """

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        rod, blocks = structure.rod, structure.blocks
        n = rod.n_tendons
        self.decisions = _consecutive(n, (block.n_decisions for block in blocks))
        self.n_decision = n + sum(block.n_decisions for block in blocks)
        first = self.n_decision + 1
        self.states = slice(first, first + rod.n_states)
        self.dependents = _consecutive(self.states.stop, (block.n_dependents for block in blocks))
        self.n_equations = rod.n_states + sum(block.n_dependents for block in blocks)
        self.size = first + self.n_equations
        conditions = [
            *rod.base_condition(),  # (R_0, u_0) = clamp,  y_0 = 0
            *rod.element_equations(),  # Phi; balance of element; - local wrench in rows of G
            *rod.stage_equations(),  # + body and tendons in the rows of G; change of y
            *rod.jumps(),  # + loads at nodes in the rows of the balance; jumps of y
            *rod.tip_condition(),  # M_N, F_N, beside the load at the tip
        ]
        of_rod = np.r_[:n, self.n_decision : self.states.stop]
        terms = [PlacedKernel(each.kernel, of_rod[each.unknowns], each.rows) for each in conditions]
        for block, own, place in zip(blocks, self.decisions, self.dependents, strict=True):
            terms += block.shares(own.start)
            terms += block.equations(of_rod, place.start, place.start - first)
        self.equations = Equations(self.size, self.n_equations, terms, rod.structure.machine_code)
        self._define_parameters()
        f, design_rows = self._objective_and_rows()
        self._differentiate(f, design_rows)

    def _define_parameters(self) -> None:
        """Set the places of all parameters, and the symbols of unknowns and parameters."""
        blocks = self.structure.blocks
        n_poses = POSE * len(self.structure.stations)
        self.measured = _consecutive(n_poses, (block.n_measured for block in blocks))
        self.poses = slice(0, n_poses)
        sizes = {
            "T_ref": 1,
            "weight": 1,
            "unit": self.structure.rod.n_tendons,
            "kernels": self.equations.n_p,
            "scale": self.n_equations,
            "row_scale": self.n_equations,
            "defect": n_poses + sum(block.n_measured for block in blocks),
        }
        self.parts = dict(zip(sizes, _consecutive(0, sizes.values()), strict=True))
        n_p = sum(sizes.values())
        self.parameters = _consecutive(n_p, (block.n_parameters for block in blocks))
        self.w = ca.MX.sym("w", self.size)
        self.p = ca.MX.sym("p", n_p + sum(block.n_parameters for block in blocks))

    def _objective_and_rows(self) -> tuple[ca.MX, ca.MX]:
        """Return the objective f and the design rows; set kinds and bounds of all rows."""
        w, p, parts, blocks = self.w, self.p, self.parts, self.structure.blocks
        n = self.structure.rod.n_tendons
        T_ref = p[parts["T_ref"]]
        T = w[:n] * p[parts["unit"]] / T_ref
        corrected = self._measured() + p[parts["defect"]]
        poses_of = ca.vertsplit(corrected[self.poses], POSE) if self.poses.stop else []
        poses = dict(zip((s for s, _ in self.structure.stations), poses_of, strict=True))
        measured = [corrected[place] for place in self.measured]
        each = [block.compliances(m) for block, m in zip(blocks, measured, strict=True)]
        compliances = ca.vertcat(ca.MX(0, 1), *each)
        rows = list[Rows]()
        misses = list[ca.MX]()
        objectives = list[ca.MX]()
        # PeakTension replaces the effort by T_peak / T_ref.
        effort = ca.sum1(T) if self.structure.norm == "1" else ca.sumsqr(T) / 2
        for k, block in enumerate(blocks):
            own = w[self.decisions[k]], measured[k], p[self.parameters[k]]
            added = block.parts(ProgramView(T, T_ref, poses, compliances, *own, effort))
            rows += added.rows
            misses += added.misses
            objectives += added.objectives
            effort = effort if added.effort is None else added.effort
        weight = p[parts["weight"]]
        objective = ca.vertcat(ca.MX(0, 1), *objectives)
        cost = ca.sum1(objective) + weight * effort if objective.numel() else effort
        is_exact = self.structure.mode == "exact"
        f = cost if is_exact else ca.sumsqr(ca.vertcat(*misses)) / 2 + weight * cost
        rows.append(Rows(EQUILIBRIUM, ca.MX(self.n_equations, 1), 0.0, 0.0))
        sizes = [each.value.numel() for each in rows]
        self.row_kinds = np.repeat([each.kind for each in rows], sizes)
        self.lower = np.repeat([each.lower for each in rows], sizes)
        self.upper = np.repeat([each.upper for each in rows], sizes)
        self.equality_rows = np.flatnonzero(self.row_kinds == EQUALITY)
        self.n_design_rows = self.row_kinds.size - self.n_equations
        return f, ca.vertcat(*(each.value for each in rows[:-1]))

    def _measured(self) -> ca.MX:
        """Return poses at the stations and the measurements of all blocks; define `measure`."""
        values = self.w * self.scale(self.p)
        states = values[self.states]
        nodes = [node for _, node in self.structure.stations]
        measured = [states[self.structure.rod.nodes[nodes, :POSE].ravel().tolist()]]
        places = zip(self.structure.blocks, self.dependents, self.parameters, strict=True)
        measured += [block.measure(states, values[x], self.p[p]) for block, x, p in places]
        result: ca.MX = ca.vertcat(*measured)
        function = ca.Function("measured", [self.w, self.p], [ca.densify(result)])
        self.measure = BufferedFunction(function)
        return result

    def scale(self, p: Any) -> Any:
        """Return the scale of each unknown (size,), from parameters."""
        n_unscaled = self.n_decision - self.structure.rod.n_tendons + 1
        return ca.vertcat(p[self.parts["unit"]], ca.DM.ones(n_unscaled), p[self.parts["scale"]])

    def _differentiate(self, f: ca.MX, design_rows: ca.MX) -> None:
        """Define the functions that ipopt receives: f, g, df/dw, dg/dw and the Hessian."""
        w, p, m = self.w, self.p, self.n_design_rows
        sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", m)
        hessian = ca.triu(ca.hessian(sigma * f + ca.dot(lam, design_rows), w)[0])
        first = [f, ca.densify(ca.gradient(f, w)), design_rows, ca.jacobian(design_rows, w)]
        self.design = ca.Function("design", [w, p, sigma, lam], [*first, hessian])
        lam = ca.MX.sym("lam", m + self.n_equations)
        f, gradient, design_rows, J, H = self.design.call([w, p, sigma, lam[:m]], True, False)
        scale = self.scale(p)
        row_scale = p[self.parts["row_scale"]]
        kernels = p[self.parts["kernels"]]
        residual = self.equations.value.function(w * scale, kernels)
        g = ca.vertcat(design_rows, residual / row_scale)
        # The residual is the last column of the assembled Jacobian.
        places = self.equations.jacobian.places
        row, column = places.row(), places.get_col()
        nonzeros = self.equations.jacobian.function(w * scale, kernels)
        scaled = nonzeros * ca.vertcat(scale, 1)[column] / row_scale[row]
        by_w, residual = ca.horzsplit(ca.MX(places, scaled), [0, self.size, self.size + 1])
        J = ca.vertcat(J, by_w)
        places = self.equations.hessian.places
        row, column = places.row(), places.get_col()
        nonzeros = self.equations.hessian.function(w * scale, kernels, lam[m:] / row_scale)
        H += ca.triu(ca.MX(places, nonzeros * scale[column] * scale[row]))
        self.function = ca.Function("program", [w, p, sigma, lam], [f, gradient, g, J, H])
        values = [f, gradient, ca.vertcat(design_rows, residual), J.nz[:]]
        self._evaluated = BufferedFunction(
            ca.Function("program", [w, p], list(map(ca.densify, values)))
        )
        self._sparsity = np.array(J.row(), np.int32), np.array(J.sparsity().colind(), np.int32)

    def evaluate(self, w: Array, p: Array) -> tuple[Array, Array, Array, csc_array]:
        """Return objective (1,), gradient, rows and Jacobian."""
        f, gradient, g, nonzeros = (value.ravel() for value in self._evaluated(w, p))
        return f, gradient, g, csc_array((nonzeros, *self._sparsity), shape=(g.size, w.size))

    def hessian(self, w: Array, p: Array, lam: Array) -> csc_array:
        """Return the Hessian of the Lagrangian, by multipliers of all rows."""
        function, row, colind = self._hessian
        (nonzeros,) = function(w, p, np.ones(1), lam)
        upper = csc_array((nonzeros.ravel(), row, colind), shape=(w.size, w.size))
        return upper + upper.T - diags_array(upper.diagonal())

    @cached_property
    def _hessian(self) -> tuple[BufferedFunction, Index, Index]:
        """The nonzeros of the upper Hessian as a function, and their places."""
        arguments = self.function.mx_in()
        H = self.function.call(arguments, True, False)[-1]
        function = BufferedFunction(ca.Function("hessian", arguments, [ca.densify(H.nz[:])]))
        return function, np.array(H.row(), np.int32), np.array(H.sparsity().colind(), np.int32)

    def relaxed(self, epsilon: float) -> Nlp:
        """Return the program with the relaxed equalities c(w) = epsilon (e - e_0).

        The unknowns are (w, e), the parameters (p, e_0).
        """
        m, n_rows = self.equality_rows.size, self.row_kinds.size
        unknowns = ca.MX.sym("w", self.size + m)
        parameters = ca.MX.sym("p", self.p.numel() + m)
        sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", n_rows)
        w, e = unknowns[: self.size], unknowns[self.size :]
        p, e_0 = ca.vertsplit(parameters, [0, self.p.numel(), parameters.numel()])
        f, gradient, g, J, H = self.function.call([w, p, sigma, lam], True, False)
        places = ca.Sparsity.triplet(n_rows, m, self.equality_rows.tolist(), list(range(m)))
        A = ca.DM(places, epsilon)
        return Nlp(
            unknowns,
            parameters,
            sigma,
            lam,
            f + ca.sumsqr(e) / 2,
            ca.vertcat(gradient, e),
            g - A @ (e - e_0),
            ca.horzcat(J, -A),
            ca.diagcat(H, sigma * ca.DM.eye(m)),
        )


def _consecutive(start: int, sizes: Iterable[int]) -> list[slice]:
    """Return slices of the given sizes, one after the other."""
    ends = accumulate(sizes, initial=start)
    return [slice(a, b) for a, b in pairwise(ends)]


@lru_cache(maxsize=16)
def program_of(structure: Structure) -> Program:
    """Return the program of a structure, shared by all problems that have it."""
    return Program(structure)
