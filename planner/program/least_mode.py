"""The least stable mode of an arm as unknowns of a program, for a margin of stability.

It is a change y of the states with J y = lambda B y, J the Jacobian of the equations against the
states and B the stiffness of the body at rest, at the stages; lambda is the eigenvalue of the
scaled Hessian of the energy (model.equilibrium.stability). Its equations are those of equilibrium
differentiated along y, less lambda B y, and the size of y. They have exact derivatives as all
others: stability with a margin is a bound on an unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from model.equilibrium.linearised import Linearised
from model.equilibrium.stability import least_modes, rest_stiffness
from model.paths import Array
from model.transcription.equations import Term
from model.transcription.kernels import Kernel, Places, mode
from model.transcription.system import System
from planner.program.states import States, numbers_of_terms


@dataclass(frozen=True)
class LeastMode:
    """The least stable mode, and its eigenvalue last; see planner.program.blocks."""

    states: States

    is_linear = False

    @property
    def size(self) -> int:
        """See Block.size."""
        return self.states.of.n_states + 1

    def terms(self, place: Places, start: int, row: int) -> list[Term]:
        """See Block.terms."""
        of, terms = self.states.of, list[Term]()
        for term in of.equations.terms:
            is_state = term.unknowns >= of.first
            if not np.all(is_state == is_state[:, :1]):
                raise AssertionError("tensions and states in one row of a term")
            rows = tuple(np.flatnonzero(is_state[:, 0]).tolist())
            change = start + term.unknowns[list(rows)] - of.first
            unknowns = np.vstack([place[term.unknowns], change])
            terms.append(Term(mode(term.kernel, rows), unknowns, row + term.rows))
        stages, last = np.ravel(of.stages), of.n_states
        unknowns = np.stack([np.full(stages.size, start + last), start + stages])
        terms.append(Term(_inertia(), unknowns, row + stages[None, :]))
        one = np.full((1, stages.size), row + last)
        return [*terms, Term(_square(), start + stages[None, :], one)]

    def numbers(self, at: System, along: Array) -> list[Array]:
        """See Block.numbers."""
        weights, stiff = self._weights(at), rest_stiffness(at)[1]
        share = np.full(weights.size, 1 / weights.size)
        return [*numbers_of_terms(at), -stiff[None, :], np.stack([weights, share])]

    def scales(self, at: System) -> tuple[Array, Array]:
        """See Block.scales."""
        state, row = self.states.scales(at)
        return np.append(state, 1.0), np.append(row, 1.0)

    def at(self, equilibrium: Linearised) -> Array:
        """Return its unknowns (size,) in an equilibrium, of the size that its equations ask for."""
        values, y = least_modes(equilibrium, 1)
        strains = y[np.ravel(self.states.of.stages), 0]
        return np.append(y[:, 0] / np.sqrt(self._weights(equilibrium.system) @ strains**2), values)

    def _weights(self, at: System) -> Array:
        """Return what the squares of the strains weigh in the size of the mode."""
        strain = self.states.scales(at)[0][np.ravel(self.states.of.stages)]
        return np.asarray(rest_stiffness(at)[0] / at.arm.length / strain**2)


@lru_cache(maxsize=1)
def _inertia() -> Kernel:
    """Return the kernel of an eigenvalue times a stiffness and a strain."""
    y, stiff = ca.SX.sym("y", 2), ca.SX.sym("stiff")
    return Kernel("inertia", y, stiff, stiff * y[0] * y[1])


@lru_cache(maxsize=1)
def _square() -> Kernel:
    """Return the kernel of a part of a mode's size, less the size that it is scaled to."""
    y, c = ca.SX.sym("y"), ca.SX.sym("c", 2)
    return Kernel("size", y, c, c[0] * y**2 - c[1])
