"""The program in stages, for fatrop, an interior-point method for optimal control.

From base to tip, stage k has as states what is the same all along (tensions, what norm and slacks
add, the load factor) and its node; as controls what is inside of its element, and the wrench at the
element's far end. So stage k alone gives x_{k+1}, and every other row is one of a single stage. A
program with rows of several stages cannot be stated so. One with exact tendons could, but their law
has a kink where a tendon is left no length; near it fatrop 1.1 makes its matrix regular for ever.

Source: Vanroye, Sathya, De Schutter, Decre, "FATROP: a fast constrained optimal control problem
solver for robot trajectory optimization and control", IROS 2023.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.cross_section.energy import EnergySection
from model.machine.functions import Buffered
from model.paths import Array
from model.transcription.kernels import Places
from model.transcription.layout import POSE
from planner.program.problem import Candidate, Problem
from planner.program.program import Program
from planner.solve.ipopt import MAGNIFIED

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
        Fatrop; None unless every row besides equilibrium is of one stage, and the law is smooth.
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
        J, m = program.function.sparsity_out(3), program.n_outer
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
        smooth = not isinstance(of.form.law, EnergySection)
        self.solver = self._solver(program) if simple and smooth and fits.all() else None

    def _seen(self, unknowns: Places, stage: Places) -> Places:
        """Return where stages see unknowns of the program, their own or those of the next node."""
        place = self.place[unknowns]
        beyond = np.where(place < self.same + POSE, self.width, self.step - POSE)
        return stage * self.width + place + np.where(self.stage[unknowns] > stage, beyond, 0)

    def _solver(self, of: Program) -> Buffered:
        """Return fatrop, of z, parameters and bounds; multipliers to begin with are of no use."""
        n, rows = self.unknown.size, self.order.tolist()
        _, p, sigma, _ = of.function.mx_in()
        z, lam = ca.MX.sym("z", n), ca.MX.sym("lam", len(rows))
        weights = lam[np.argsort(self.order)[: of.rows.size].tolist()]
        arguments = z[self.origin.tolist()], p, MAGNIFIED * sigma, weights
        f, slope, g, J, H = of.function.call(arguments, True, False)
        slope = _placed(MAGNIFIED * slope, self.origin, 0 * self.origin, (n, 1))
        row, column = np.array(J.row()), np.array(J.sparsity().get_col())
        J = _placed(J, row, self._seen(column, self._of_row[row]), (of.rows.size, n))
        H = ca.triu2symm(H)
        row, column = np.array(H.row()), np.array(H.sparsity().get_col())
        pair = np.sort(self.stage[[row, column]], axis=0)
        first = np.maximum(np.where(pair[0] < 0, pair[1], pair[0]), 0)
        H = _placed(H, self._seen(row, first), self._seen(column, first), (n, n))
        # Rows that tie copies, and the load factor last.
        j, k = (index.ravel() for index in np.meshgrid(self._ties, np.arange(self.count)))
        copy = k * self.width + np.where(j < self.same, j, j + self.step - POSE)
        tied = z[((k + 1) * self.width + j).tolist()] - z[copy.tolist()]
        tied = ca.vertcat(tied, z[self.same - 1])
        f, g = MAGNIFIED * f, ca.vertcat(g, tied)[rows]
        # What is handed over by its nonzeros has to be dense.
        slope, J = ca.densify(slope), ca.vertcat(J, ca.jacobian(tied, z))[rows, :]
        gradient = sigma * slope + J.T @ lam
        # Derivatives, which it finds where CasADi keeps its own: how many of the symbols they take.
        symbols = {"x": z, "p": p, "lam_f": sigma, "lam_g": lam}
        results = {
            "nlp_grad_f": (2, {"grad_f_x": slope}),
            "nlp_jac_g": (2, {"g": g, "jac_g_x": J}),
            "nlp_hess_l": (4, {"grad_gamma_x": gradient, "hess_gamma_x_x": H}),
            "nlp_grad": (
                4,
                {
                    "f": f,
                    "g": g,
                    "grad_gamma_x": gradient,
                    "grad_gamma_p": ca.MX.zeros(p.numel()),
                },
            ),
        }
        derivatives = dict[str, ca.Function]()
        for name, (count, values) in results.items():
            at = dict(list(symbols.items())[:count])
            derivatives[name] = ca.Function(name, at | values, list(at), list(values))
        equal = np.append(of.lower == of.upper, np.full(tied.numel(), True))
        options: dict[str, Any] = {
            "structure_detection": "auto",
            "equality": equal[rows].tolist(),
            "cache": derivatives,
            "print_time": False,
            "error_on_fail": False,
            "show_eval_warnings": False,
            "calc_lam_p": False,
            "fatrop": _OPTIONS,
        }
        return Buffered(ca.nlpsol("fatrop", "fatrop", {"x": z, "p": p, "f": f, "g": g}, options))


def _placed(matrix: ca.MX, rows: Places, columns: Places, size: tuple[int, int]) -> ca.MX:
    """Return a matrix of a size with the nonzeros of another at other places."""
    places, index = ca.Sparsity.triplet(*size, rows.tolist(), columns.tolist(), False)
    return ca.MX(places, matrix.nz[index])


# Programs stage by stage, built once.
stages = lru_cache(maxsize=16)(Stages)


def solve(problem: Problem, x: Array, p: Array) -> Candidate | None:
    """Return what fatrop makes of x; None where it has no solver, see Stages.

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
    z, f, _, lam_x, lam_g, _ = (value.ravel() for value in result)
    stats, back = of.solver.stats(), np.argsort(of.order)[: lbg.size]
    met, count = bool(stats["success"] and np.isfinite(z).all()), int(stats["iter_count"])
    lam_x = np.concatenate([lam_x[:n], np.zeros(x.size - n)]) / MAGNIFIED
    values = z[of.origin], lam_x, lam_g[back] / MAGNIFIED, float(f[0]) / MAGNIFIED
    return Candidate(*values, met, count, "fatrop", problem=problem)
