"""The responses of an arm to small forces on its tip, for targets that are stated with stiffness.

A response is the change Y of all unknowns of the equations of equilibrium by a small force, which
are differentiated along Y, and tendons that are held by their tensions or their lengths meanwhile.
Its equations have exact derivatives as all others, and with them the compliance has, as what the
tip is displaced by along the force.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.cross_section.law import CrossSection, size
from model.machine.compiled import built
from model.paths import Array
from model.transcription.element import run
from model.transcription.equations import Term
from model.transcription.kernels import Kernel, Places, tangent
from model.transcription.layout import POSE
from model.transcription.system import System
from model.winches import least_compliance
from planner.program.blocks import scaled
from planner.program.states import States, numbers_of_terms
from planner.targets.base import ComplianceRequest


@dataclass(frozen=True)
class Responses:
    """The responses to forces along the directions of a target; see planner.program.blocks.

    Attributes
    ----------
    states : States
    request : ComplianceRequest
    first : int
        Where its directions are among those of all targets.
    """

    states: States
    request: ComplianceRequest
    first: int

    is_linear = True

    @property
    def size(self) -> int:
        """See Block.size."""
        return self.request.width * self.states.of.n_x

    @property
    def directions(self) -> range:
        """Which of the directions of all targets are its own."""
        return range(self.first, self.first + self.request.width)

    def terms(self, place: Places, start: int, row: int) -> list[Term]:
        """See Block.terms."""
        terms = list[Term]()
        for k in range(self.request.width):
            shift = k * self.states.of.n_x
            terms += self._response(place, start + shift, row + shift)
        return terms

    def _response(self, place: Places, start: int, row: int) -> list[Term]:
        """Return the terms of one response: of equilibrium, of the tensions, of the load factor."""
        of, terms = self.states.of, list[Term]()
        for term in of.equations.terms:
            unknowns = np.vstack([place[term.unknowns], start + term.unknowns])
            terms.append(Term(tangent(term.kernel), unknowns, row + term.rows))
        n, row = of.n_tendons, row + of.n_states
        tensions, rows = start + np.arange(n)[None, :], row + np.arange(n)[None, :]
        terms.append(Term(scaled(), np.array([[start + n]]), np.array([[row + n]])))
        if self.request.hold == "length":
            (lengths,) = of.lengths.terms
            own = start + lengths.unknowns, start + lengths.rows
            unknowns = np.vstack([place[lengths.unknowns], *own])
            terms.append(Term(_locked(of.form.law), unknowns, row + lengths.rows))
        return [*terms, Term(scaled(), tensions, rows)]

    def numbers(self, at: System, along: Array) -> list[Array]:
        """See Block.numbers."""
        columns, of, of_terms = list[Array](), self.states.of, numbers_of_terms(at)
        for k in self.directions:
            for term, numbers in zip(of.equations.terms, of_terms, strict=True):
                change = np.zeros_like(numbers)
                if term.kernel.name == "element":
                    change[1:4] = unit_force(at.arm) * along[:, k, None]
                columns.append(np.vstack([numbers, change]))
            columns.append(np.ones((1, 1)))
            kept = 1.0
            if self.request.hold == "length":
                lengths, EA = at.length_numbers.reshape(-1, 5).T, self.request.tendon_EA
                stretch = np.full((1, lengths.shape[1]), 0.0 if EA is None else 1 / EA)
                columns.append(np.vstack([lengths, stretch]))
                kept = -least_compliance(at.arm)
            columns.append(np.full((1, of.n_tendons), kept))
        return columns

    def scales(self, at: System) -> tuple[Array, Array]:
        """See Block.scales."""
        state, row = self.states.scales(at)
        force, n, width = unit_force(at.arm), self.states.of.n_tendons, self.request.width
        length = at.arm.length if self.request.hold == "length" else force
        unknowns = np.concatenate([np.full(n + 1, force), state])
        rows = np.concatenate([row, np.full(n, length), [1.0]])
        return np.tile(unknowns, width), np.tile(rows, width)

    def displaced(self, unknowns: ca.MX) -> ca.MX:
        """Return the displacements (3, width) of the tip, of its unknowns in SI."""
        by_force = ca.reshape(unknowns, self.states.of.n_x, self.request.width)
        return by_force[(self.states.of.first + self.states.of.nodes[-1, 4:POSE]).tolist(), :]


def unit_force(arm: Arm) -> float:
    """Return the small force of the responses [N]: it bends the straight arm by about 1 rad."""
    R = float(arm.radius.evaluate(np.zeros(1), arm.length)[0][0])
    return float(arm.material.E * np.pi * R**4 / 4 / arm.length**2)


@lru_cache(maxsize=16)
def _locked(law: CrossSection) -> Kernel:
    """Return the kernel of a locked tendon: how its path lengthens, less how its tension does.

    Strains, their changes, change of its tension; its path and a weight, 1 / E A of the tendon.
    """
    kernel = built(run, law)
    change, pull = ca.SX.sym("change", size(law)), ca.SX.sym("pull")
    compliance = ca.SX.sym("compliance")
    grows = ca.jtimes(kernel.r, kernel.y, change) - kernel.r * pull * compliance
    y = ca.vertcat(kernel.y, change, pull)
    return Kernel("locked", y, ca.vertcat(kernel.c, compliance), grows)
