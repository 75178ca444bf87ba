"""The program over shapes that settle by themselves, and an optimum of it.

Least f = |T|^2 / 2 + W |soft residuals|^2 / 2, scaled, with equalities = 0, inequalities >= 0 and
limits. Its unknowns are the tensions over what bends the arm alike, then the tangential forces of
holds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model.errors import OctoplanError
from model.paths import Array
from planner.contact.settled_terms import SettledTerms

# What is near costs before effort, in units of the arm's length and of the scale of tensions.
NEAREST = 1e6
# The penalty of what targets lack, to begin with.
PENALTY = 10.0
# The least that tangential forces cost, so that those that nothing determines stay.
_COST = 1e-9


@dataclass(frozen=True, eq=False)
class Program:
    """The program.

    Attributes
    ----------
    evaluate : callable
        Tensions, an equilibrium near, tangential forces -> terms there.
    lower, upper : (n,)
        Limits [N].
    total : float
        The most that all tendons pull together [N].
    scale : float
        Of effort [N].
    units : (n,)
        Of the tensions, such as bend the arm alike [N]: what steps are measured in.
    has_history : bool
        Whether equilibria are come to from one alone, against friction, whatever is near.
    """

    evaluate: Callable[[Array, SettledTerms | None, Array | None], SettledTerms]
    lower: Array
    upper: Array
    total: float
    scale: float
    units: Array
    has_history: bool = False
    least: float = 0.0

    def units_of(self, terms: SettledTerms) -> Array:
        """Return the units of all unknowns."""
        return np.concatenate([self.units, np.ones(terms.tangential.size)])

    def room(self, terms: SettledTerms) -> tuple[Array, Array]:
        """Return how far down and up the unknowns may step, scaled."""
        none = np.full(terms.tangential.size, np.inf)
        down, up = (self.lower - terms.tensions), (self.upper - terms.tensions)
        return np.append(down / self.units, -none), np.append(up / self.units, none)

    def sums(self, terms: SettledTerms) -> Array:
        """Return the row (1, n) that adds up tensions, over the largest unit."""
        own = self.units / self.units.max()
        return np.append(own, np.zeros(terms.tangential.size))[None]

    def rows(self, terms: SettledTerms, kind: str) -> Array:
        """Return the derivatives of terms by the scaled unknowns."""
        return np.asarray(terms.jacobian[kind] * self.units_of(terms))

    def moved(self, terms: SettledTerms, step: Array, clip: bool = True) -> SettledTerms | None:
        """Return the terms after a step of the scaled unknowns; None where the arm jumps."""
        n = self.units.size
        T = terms.tensions + self.units * step[:n]
        T = np.clip(T, self.lower, self.upper) if clip else T
        try:
            return self.evaluate(T, terms, terms.tangential + step[n:])
        except OctoplanError:
            return None

    def objective(self, terms: SettledTerms) -> float:
        """Return what is made least."""
        near, own = terms.values["soft_residual"], terms.tensions / self.scale
        return (
            float(own @ own + NEAREST * near @ near + _COST * terms.tangential @ terms.tangential)
            / 2
        )

    def effort_gradient(self, terms: SettledTerms) -> Array:
        """Return the gradient of effort by the scaled unknowns (n,)."""
        own = self.units * terms.tensions / self.scale**2
        return np.append(own, _COST * terms.tangential)

    def gradient(self, terms: SettledTerms) -> Array:
        """Return the gradient of the objective by the scaled unknowns (n,)."""
        return np.asarray(
            self.effort_gradient(terms)
            + NEAREST * self.rows(terms, "soft_residual").T @ terms.values["soft_residual"]
        )

    def effort_hessian(self, terms: SettledTerms) -> Array:
        """Return the Hessian of effort (n, n)."""
        own = (self.units / self.scale) ** 2
        return np.diag(np.append(own, np.full(terms.tangential.size, _COST)))

    def predicted(self, terms: SettledTerms, step: Array, penalty: float) -> float:
        """Return the penalised objective that linear terms predict after a step."""
        moved = self._moved(terms, step)
        n = self.units.size
        T = (terms.tensions + self.units * step[:n]) / self.scale
        z = terms.tangential + step[n:]
        f = (
            float(T @ T + NEAREST * moved["soft_residual"] @ moved["soft_residual"] + _COST * z @ z)
            / 2
        )
        return f + penalty * _lacking(moved)

    def predicted_violation(self, terms: SettledTerms, step: Array) -> float:
        """Return what equality and inequality lack after a step, as linear terms predict."""
        return _lacking(self._moved(terms, step))

    def _moved(self, terms: SettledTerms, step: Array) -> dict[str, Array]:
        """Return the terms that their derivatives predict after a step."""
        return {kind: own + self.rows(terms, kind) @ step for kind, own in terms.values.items()}

    def merit(self, terms: SettledTerms, penalty: float) -> float:
        """Return the penalised objective."""
        return self.objective(terms) + penalty * lacking(terms)


@dataclass(frozen=True, eq=False)
class Optimum:
    """Where the program ended.

    Attributes
    ----------
    terms : SettledTerms
    lam_bounds, lam_equality, lam_inequality : multipliers of tensions, equality and inequality
        Scaled.
    kkt : float
        Residual of the first-order conditions, scaled.
    steps : tuple of (n_tendons,)
        Tensions from the start to the optimum, at each step that was taken.
    """

    terms: SettledTerms
    lam_bounds: Array
    lam_equality: Array
    lam_inequality: Array
    kkt: float
    steps: tuple[Array, ...] = ()

    @property
    def lacks(self) -> float:
        """What equalities and inequalities lack together."""
        return lacking(self.terms)

    @property
    def effort(self) -> float:
        """Root of the sum of squared tensions [N]."""
        return float(np.linalg.norm(self.terms.tensions))


def lacking(terms: SettledTerms) -> float:
    """Return what equality and inequality lack together."""
    return _lacking(terms.values)


def _lacking(values: dict[str, Array]) -> float:
    equality, inequality = values["equality"], values["inequality"]
    return float(np.abs(equality).sum() + np.maximum(-inequality, 0.0).sum())
