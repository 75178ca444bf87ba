"""What the strains' equations ask of an integrator: one step, from numbers known inside of it."""

from __future__ import annotations

from typing import Protocol

import casadi as ca

from model.paths import Array


class Integrator(Protocol):
    """A way across a step of x' = slope(x, d), where d are numbers of the cross-section.

    What d is between the samples an integrator need not know, or takes from a polynomial through
    them: body and tendon paths have no knots inside a step. Integrators are frozen values.
    """

    def __hash__(self) -> int:
        """Return the hash of the value."""

    @property
    def name(self) -> str:
        """The name that scripts use."""

    @property
    def order(self) -> int:
        """The power of the refinement by which the error falls, at least."""

    @property
    def samples(self) -> tuple[float, ...]:
        """Where in a step, from 0 to 1, it takes numbers of the cross-section."""

    def refined(self, refinement: int) -> Integrator:
        """Return the integrator for a mesh of a refinement: itself, but for its tolerance."""

    def stepper(self, slope: ca.Function, scale: Array) -> ca.Function:
        """Return (x (n_x,), d at the samples (n_d, m), h) -> x after a step of length h [m].

        Parameters
        ----------
        slope : casadi.Function
            (x, d (n_d,)) -> derivative of x along s.
        scale : (n_x,)
            What one unit of each component of x is worth: tolerances are in these units.
        """
