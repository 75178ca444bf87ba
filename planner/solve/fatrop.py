"""The program in stages, for fatrop, an interior-point method for optimal control.

From base to tip, stage k has as states what is the same all along (tensions, what norm and slacks
add, the load factor) and its node; as controls what is inside of its element, and the wrench at the
element's far end. So stage k alone gives x_{k+1}, and every other row is one of a single stage. A
program with rows of several stages cannot be stated so.

Source: Vanroye, Sathya, De Schutter, Decre, "FATROP: a fast constrained optimal control problem
solver for robot trajectory optimization and control", IROS 2023.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.machine.buffered import Buffered
from model.paths import Array
from model.transcription.kernels import Places
from model.transcription.layout import POSE
from planner.program.problem import Problem
from planner.program.program import Program
from planner.solve.ipopt import MAGNIFIED, Candidate

# It goes no further than this tolerance, and what takes longer wanders: that is left to ipopt.
_OPTIONS = {"print_level": 0, "tol": 1e-6, "mu_init": 0.1, "max_iter": 30}


class Stages:
    """A program with its unknowns z and its rows stage by stage.

    A stage sees copies of what is the same all along, and of the next node. Rows, linear in z, tie
    them; as they hold from the first iterate on, all else may be evaluated at the first copies, and
    its derivatives be put at those of the stage.

    Attributes
    ----------
    solver : Buffered or None
        Fatrop; None unless every row besides equilibrium is of one stage.
    unknown : (n_z,)
        The unknown of the program that each one is.
    origin : (size,)
        Where each unknown of the program is first.
    order : (n_rows,)
        Stage by stage the rows of the program and those that tie copies.
    """

    def __init__(self, program: Program) -> None:
        of = program.states.of
        self.count = of.elements
        self.same, self.node, self.step = program.n_free + 1, of.node_size, of.stride
        self.width = self.same + self.step + self.node - POSE
        k, part = np.divmod(np.arange(self.count * self.width + self.same + self.node), self.width)
        copies = part >= self.same + self.step
        self.unknown = part + np.where(part < self.same, 0, k * self.step) + POSE * copies
        all_of = np.arange(program.size)
        stage, self.place = np.divmod(all_of - self.same, self.step)
        self.stage = np.where(all_of < self.same, -1, stage)
        self.place = np.where(all_of < self.same, all_of, self.same + self.place)
        self.origin = self._seen(all_of, np.maximum(self.stage, 0))
        # Stages of rows, and the first in each that give x_{k+1}; then those that tie copies.
        J, m = program.jacobian.sparsity(), program.outer.numel()
        row, column = np.array(J.row()), np.array(J.get_col())
        outer = np.zeros(m, dtype=np.int64)
        np.maximum.at(outer, row[row < m], self.stage[column[row < m]])
        k, part = np.divmod(np.arange(program.n_equations), self.step)
        gives = (part < POSE) & (k > 0)
        ties = np.delete(np.arange(self.same + self.node), self.same + np.arange(POSE))
        self._of_row = np.concatenate([outer, k - gives])
        stage = np.concatenate([self._of_row, np.repeat(np.arange(self.count), ties.size), [0]])
        places = np.where(gives, self.same + part, self.width), np.tile(ties, self.count)
        place = np.concatenate([np.full(m, self.width), *places, [self.width]])
        self.order, self._ties = np.lexsort([place, stage]), ties
        near = self.stage[column] - self._of_row[row]
        fits = np.where(row < m, near == 0, near <= 1) | (self.stage[column] < 0)
        simple = program.n_equations == of.n_states and not of.form.friction
        self.solver = self._solver(program) if simple and fits.all() else None

    def _seen(self, unknowns: Places, stage: Places) -> Places:
        """Return where stages see unknowns of the program, their own or those of the next node."""
        place = self.place[unknowns]
        beyond = np.where(place < self.same + POSE, self.width, self.step - POSE)
        return stage * self.width + place + np.where(self.stage[unknowns] > stage, beyond, 0)

    def _tied(self) -> ca.DM:
        """Return the matrix of the rows that tie copies, and the load factor last."""
        j, k = (index.ravel() for index in np.meshgrid(self._ties, np.arange(self.count)))
        copy = np.where(j < self.same, j, j + self.step - POSE) + k * self.width
        places = np.concatenate([(k + 1) * self.width + j, copy, [self.same - 1]])
        rows = np.concatenate([np.arange(k.size), np.arange(k.size), [k.size]])
        values = ca.DM(np.repeat([1.0, -1.0, 1.0], [k.size, k.size, 1]))
        size = k.size + 1, self.unknown.size
        return ca.DM.triplet(rows.tolist(), places.tolist(), values, *size)

    def _solver(self, of: Program) -> Buffered:
        """Return fatrop, of z, parameters and bounds; multipliers to begin with are of no use."""
        n, rows, tied = self.unknown.size, self.order.tolist(), self._tied()
        z, p, sigma, lam = ca.MX.sym("z", n), of.p, of.sigma, ca.MX.sym("lam", len(rows))
        program = ca.Function(
            "program", [of.x, p, sigma, of.lam], [of.f, of.gradient, of.g, of.jacobian, of.hessian]
        )
        weights = lam[np.argsort(self.order)[: of.lam.numel()].tolist()]
        arguments = z[self.origin.tolist()], p, MAGNIFIED * sigma, weights
        f, gradient, g, J, H = program.call(arguments, True, False)
        row, column = np.array(J.row()), np.array(J.sparsity().get_col())
        J = _placed(J, row, self._seen(column, self._of_row[row]), (row.max() + 1, n))
        row, column = np.array(H.row()), np.array(H.sparsity().get_col())
        pair = np.sort(self.stage[[row, column]], axis=0)
        first = np.maximum(np.where(pair[0] < 0, pair[1], pair[0]), 0)
        H = _placed(H, self._seen(row, first), self._seen(column, first), (n, n))
        at = self.origin.tolist()
        chosen = ca.DM(ca.Sparsity.triplet(len(at), n, list(range(len(at))), at), 1.0)
        equal = [r.lower == r.upper for r in of.rows for _ in range(r.size)]
        equal += [True] * (len(rows) - len(equal))
        return _fatrop(
            {"x": z, "p": p, "f": MAGNIFIED * f, "g": ca.vertcat(g, tied @ z)[rows]},
            (sigma, lam),
            # What is handed over by its nonzeros has to be dense.
            (ca.densify(MAGNIFIED * (chosen.T @ gradient)), ca.vertcat(J, tied)[rows, :]),
            H,
            [equal[row] for row in rows],
        )


def _placed(matrix: ca.MX, rows: Places, columns: Places, size: tuple[int, int]) -> ca.MX:
    """Return a matrix of a size with the nonzeros of another at other places."""
    places, index = ca.Sparsity.triplet(*size, rows.tolist(), columns.tolist(), False)
    return ca.MX(places, matrix.nz[index])


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
    derivatives = {
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
        "cache": derivatives,
        "print_time": False,
        "error_on_fail": False,
        "show_eval_warnings": False,
        "calc_lam_p": False,
        "fatrop": _OPTIONS,
    }
    return Buffered(ca.nlpsol("fatrop", "fatrop", nlp, options))


def solve(problem: Problem, x: Array, p: Array) -> Candidate | None:
    """Return what fatrop makes of x; None where the program has rows of several stages.

    Also where a tension has no room to change.
    """
    (lbx, ubx, lbg, ubg), of, n = problem.bounds, stages(problem.program), problem.n_free
    if of.solver is None or np.any(lbx[:n] == ubx[:n]):
        return None
    low, high = (np.full(of.unknown.size, side * np.inf) for side in (-1, 1))
    low[:n], high[:n] = lbx[:n], ubx[:n]
    tied = np.append(np.zeros(of.order.size - lbg.size - 1), 1.0)
    rows = [np.concatenate([each, tied])[of.order] for each in (lbg, ubg)]
    none = np.zeros(low.size), np.zeros(of.order.size)
    result = of.solver(x[of.unknown], p, low, high, *rows, *none)
    z, f, g, lam_x, lam_g, _ = (value.ravel() for value in result)
    stats, back = of.solver.stats(), np.argsort(of.order)[: lbg.size]
    met = bool(stats["success"]) and bool(np.isfinite(z).all())
    why = "the iteration limit was reached"
    lam_x = np.concatenate([lam_x[:n], np.zeros(x.size - n)]) / MAGNIFIED
    values = z[of.origin], lam_x, lam_g[back] / MAGNIFIED, float(f[0]) / MAGNIFIED, g[back]
    count, reason = int(stats["iter_count"]), "" if met else why
    return Candidate(*values, met, reason, count, "fatrop", problem=problem)
