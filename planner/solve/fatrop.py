"""The program in stages, for fatrop, an interior-point method for optimal control.

From base to tip, stage k has as states what is the same all along (tensions, what norm and slacks
add, the load factor) and its node; as controls what is inside of its element, and the wrench at the
element's far end. So stage k alone gives x_{k+1}, and every other row is one of a single stage. A
program with rows of several stages cannot be stated so.

Source: Vanroye, Sathya, De Schutter, Decre, "FATROP: a fast constrained optimal control problem
solver for robot trajectory optimization and control", IROS 2023.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.machine.buffered import Buffered
from model.paths import Array
from model.transcription.kernel import Places
from model.transcription.layout import POSE
from model.transcription.terms import Equations, Term
from planner.program.problem import Bounds, Problem
from planner.program.program import Program
from planner.solve.ipopt import MAGNIFIED, Solution

# It goes no further than this tolerance, and what takes longer wanders: that is left to ipopt.
_OPTIONS = {"print_level": 0, "tol": 1e-6, "mu_init": 0.1, "max_iter": 30}


class Stages:
    """A program with its unknowns z and its rows stage by stage.

    Attributes
    ----------
    possible : bool
        Whether every row, and every product of two unknowns, is of one stage.
    unknown : (n_z,)
        The unknown of the program that each one is.
    origin : (size,)
        Where each unknown of the program is first.
    """

    def __init__(self, program: Program) -> None:
        of = program.blocks.of
        self.program, self.count = program, of.elements
        self.same, self.node, self.step = program.n_free + 1, of.node_size, of.stride
        self.width = self.same + self.step + self.node - POSE
        k, part = np.divmod(np.arange(self.count * self.width + self.same + self.node), self.width)
        copies = part >= self.same + self.step
        self.unknown = part + np.where(part < self.same, 0, k * self.step) + POSE * copies
        all_of = np.arange(program.size)
        self.stage, _ = self._split(all_of)
        self.origin = self._seen(all_of, np.maximum(self.stage, 0))
        self.possible = not (program.blocks.n_answers or of.form.friction) and self._is_banded()

    def _split(self, unknowns: Places) -> tuple[Places, Places]:
        """Return the stages of unknowns of the program, -1 for all stages, and places there."""
        stage, place = np.divmod(unknowns - self.same, self.step)
        same = unknowns < self.same
        return np.where(same, -1, stage), np.where(same, unknowns, self.same + place)

    def _seen(self, unknowns: Places, stage: Places) -> Places:
        """Return where stages see unknowns of the program, their own or those of the next node."""
        own, place = self._split(unknowns)
        beyond = np.where(place < self.same + POSE, self.width, self.step - POSE)
        return stage * self.width + place + np.where(own > stage, beyond, 0)

    def _is_banded(self) -> bool:
        """Return whether rows besides equilibrium, and products in them, are of one stage each."""
        J, H = (
            own.sparsity() for own in (self._outer_jacobian, self.program.symbols.outer_hessian)
        )
        of_row, of_column = self.outer[J.row()], self.stage[J.get_col()]
        first, second = self.stage[H.row()], self.stage[H.get_col()]
        return bool(np.all(np.maximum(of_column, 0) == of_row) and np.all(first == second))

    @property
    def _outer_jacobian(self) -> ca.MX:
        return self.program.symbols.outer_jacobian

    @cached_property
    def outer(self) -> Places:
        """The stage of each row besides equilibrium."""
        J = self._outer_jacobian.sparsity()
        found = np.zeros(J.size1(), dtype=np.int64)
        np.maximum.at(found, J.row(), self.stage[J.get_col()])
        return found

    @cached_property
    def order(self) -> Places:
        """Stage by stage the rows of the program and those that tie copies.

        Of each stage those come first that give x_{k+1}.
        """
        k, part = np.divmod(np.arange(self.program.blocks.n_rows), self.step)
        gives = (part < POSE) & (k > 0)
        after = self.width
        stage: list[Places] = [
            self.outer,
            k - gives,
            np.repeat(np.arange(self.count), self._ties.size),
        ]
        place: list[Places] = [0 * self.outer + after, np.where(gives, self.same + part, after)]
        place += [np.tile(self._ties, self.count), np.array([after])]
        return np.lexsort([np.concatenate(place), np.append(np.concatenate(stage), 0)])

    @property
    def _ties(self) -> Places:
        """Places in a stage of the states that are copies: all but the pose."""
        return np.delete(np.arange(self.same + self.node), self.same + np.arange(POSE))

    @cached_property
    def tied(self) -> ca.DM:
        """The matrix of the rows that tie copies, and the load factor last."""
        k, j = (
            own.ravel() for own in np.meshgrid(np.arange(self.count), self._ties, indexing="ij")
        )
        here = np.where(j < self.same, j, j + self.step - POSE) + k * self.width
        places = np.concatenate([(k + 1) * self.width + j, here, [self.same - 1]])
        rows = np.concatenate([np.arange(k.size), np.arange(k.size), [k.size]])
        values = ca.DM(np.repeat([1.0, -1.0, 1.0], [k.size, k.size, 1]))
        size = k.size + 1, self.unknown.size
        return ca.DM.triplet(rows.tolist(), places.tolist(), values, *size)

    @cached_property
    def solver(self) -> Buffered:
        """Fatrop, of z, parameters and bounds; multipliers to begin with are of no use to it."""
        program, of = self.program, self.program.symbols
        z, p, sigma = ca.MX.sym("z", self.unknown.size), of.p, of.sigma
        lam = ca.MX.sym("lam", self.order.size)
        n, m, at = self.origin.size, self.outer.size, self.origin.tolist()
        first = ca.Function("first", [of.x, p], [of.f, of.gradient, of.outer, of.outer_jacobian])
        second = ca.Function("second", [of.x, p, sigma, of.outer_lam], [of.outer_hessian])
        chosen = ca.DM(ca.Sparsity.triplet(n, self.unknown.size, list(range(n)), at), 1.0)
        f, gradient, outer, J = first(z[at], p)
        equations, numbers = self._equations(), p[program.parts.numbers]
        whole, row_scale = of.whole[self.unknown.tolist()], p[program.parts.row_scale]
        g = ca.vertcat(outer, equations.value(z * whole, numbers) / row_scale, self.tied @ z)
        nonzeros, places = equations.jacobian
        row, column = places.row(), places.get_col()
        inner = nonzeros(z * whole, numbers) * whole[column] / row_scale[row]
        J = ca.vertcat(J @ chosen, ca.MX(places, inner), self.tied)
        weights = lam[np.argsort(self.order).tolist()]
        nonzeros, places = equations.hessian
        row, column = places.row(), places.get_col()
        inner = nonzeros(z * whole, numbers, weights[m : m + row_scale.numel()] / row_scale)
        H = chosen.T @ second(z[at], p, MAGNIFIED * sigma, weights[:m]) @ chosen
        rows = self.order.tolist()
        return _fatrop(
            {"x": z, "p": p, "f": MAGNIFIED * f, "g": g[rows]},
            (sigma, lam),
            # What is handed over by its nonzeros has to be dense.
            (ca.densify(MAGNIFIED * (chosen.T @ gradient)), J[rows, :]),
            H + ca.MX(places, inner * whole[column] * whole[row]),
            self._equalities()[self.order].tolist(),
        )

    def _equations(self) -> Equations:
        """Return equilibrium in the unknowns z, each term in those of its stage."""
        blocks, terms = self.program.blocks, []
        for term in blocks.terms():
            stage, _ = self._split(term.unknowns)
            first = np.where(stage < 0, self.count, stage).min(axis=0)
            terms.append(Term(term.kernel, self._seen(term.unknowns, first), term.rows))
        return Equations(self.unknown.size, blocks.n_rows, terms, blocks.of.form.machine_code)

    def _equalities(self) -> Places:
        """Return which rows are equalities."""
        outer = [np.full(r.size, r.lower == r.upper) for r in self.program.outer_rows]
        return np.concatenate([*outer, np.full(self.order.size - self.outer.size, True)])


@lru_cache(maxsize=16)
def stages(program: Program) -> Stages:
    """Return a program stage by stage, built once."""
    return Stages(program)


def _fatrop(
    nlp: dict[str, ca.MX],
    weights: tuple[ca.MX, ca.MX],
    first: tuple[ca.MX, ca.MX],
    H: ca.MX,
    equality: list[bool],
) -> Buffered:
    """Return fatrop for a program with its own derivatives, which it finds where CasADi keeps its.

    They are the gradient, the Jacobian and the Lagrangian's Hessian, of the weights of objective
    and rows.
    """
    (x, p, f, g), (sigma, lam), (slope, J) = nlp.values(), weights, first
    at, all_of = [x, p], [x, p, sigma, lam]
    gradient = sigma * slope + J.T @ lam
    names, every = ["x", "p"], ["x", "p", "lam_f", "lam_g"]
    known = {
        "nlp_grad_f": ca.Function("nlp_grad_f", at, [slope], names, ["grad_f_x"]),
        "nlp_jac_g": ca.Function("nlp_jac_g", at, [g, J], names, ["g", "jac_g_x"]),
        "nlp_hess_l": ca.Function(
            "nlp_hess_l", all_of, [gradient, H], every, ["grad_gamma_x", "hess_gamma_x_x"]
        ),
        "nlp_grad": ca.Function(
            "nlp_grad",
            all_of,
            [f, g, gradient, ca.MX.zeros(p.numel())],
            every,
            ["f", "g", "grad_gamma_x", "grad_gamma_p"],
        ),
    }
    options: dict[str, Any] = {
        "structure_detection": "auto",
        "equality": equality,
        "cache": known,
        "print_time": False,
        "error_on_fail": False,
        "show_eval_warnings": False,
        "calc_lam_p": False,
        "fatrop": _OPTIONS,
    }
    return Buffered(ca.nlpsol("fatrop", "fatrop", nlp, options))


def solve(problem: Problem, x: Array, p: Array, bounds: Bounds) -> Solution | None:
    """Return what fatrop makes of x; None where the program has rows of several stages.

    Also where a tension has no room to change.
    """
    (lbx, ubx, lbg, ubg), of, n = bounds, stages(problem.program), problem.n_free
    if not of.possible or np.any(lbx[:n] == ubx[:n]):
        return None
    low, high = (np.full(of.unknown.size, side * np.inf) for side in (-1, 1))
    low[:n], high[:n] = lbx[:n], ubx[:n]
    tied = np.append(np.zeros(of.order.size - lbg.size - 1), 1.0)
    rows = [np.concatenate([own, tied])[of.order] for own in (lbg, ubg)]
    none = np.zeros(low.size), np.zeros(of.order.size)
    found = of.solver(x[of.unknown], p, low, high, *rows, *none)
    z, f, g, lam_x, lam_g, _ = (value.ravel() for value in found)
    stats, back = of.solver.stats(), np.argsort(of.order)[: lbg.size]
    met, why = bool(stats["success"]), "the iteration limit was reached"
    lam_x = np.concatenate([lam_x[:n], np.zeros(x.size - n)]) / MAGNIFIED
    values = z[of.origin], lam_x, lam_g[back] / MAGNIFIED, float(f[0]) / MAGNIFIED, g[back]
    return Solution(*values, met, "" if met else why, int(stats["iter_count"]), "fatrop")
