"""Integrators that choose their own steps and orders between two nodes of the mesh, by CasADi.

CVODES: A. C. Hindmarsh et al., "SUNDIALS: Suite of nonlinear and differential/algebraic equation
solvers", ACM Trans. Math. Softw. 31 (2005), here with Adams' formulas, as the equations are not
stiff. `erk`: the pair of order 5(4) of J. R. Dormand, P. J. Prince, "A family of embedded
Runge-Kutta formulae", J. Comput. Appl. Math. 6 (1980).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from model.paths import Array

# Between two nodes radius and offsets are at most cubic in s, and what the equations take from them
# has at most the fourth power of the radius: polynomials of degree 12 are exact.
_DEGREE = 12
_POINTS = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
# What refining by r divides the tolerance by is r^6, as halved steps of order 5 do to local errors.
_POWER = 6


@dataclass(frozen=True)
class Adaptive:
    """An integrator with a tolerance, relative and absolute, in scaled states.

    It starts anew at each node of the mesh. Refining by r brings the nodes closer by r, as for any
    scheme, and divides the tolerance by r^6. Where the tolerance meets rounding it fails.

    Attributes
    ----------
    name : str
        CasADi's.
    order : int
        See Integrator.order. Errors fall more slowly than tolerances do, and unevenly; this is what
        they keep to.
    tolerance : float
        That of refinement 1, from where on errors follow it.
    options : tuple of (str, value)
        CasADi's.
    """

    name: str
    order: int
    tolerance: float
    options: tuple[tuple[str, str | float], ...]

    @property
    def samples(self) -> tuple[float, ...]:
        """See Integrator.samples: Chebyshev points (13,)."""
        return tuple(((1 + _POINTS) / 2).tolist())

    def refined(self, refinement: int) -> Adaptive:
        """See Integrator.refined."""
        return replace(self, tolerance=self.tolerance / refinement**_POWER)

    def stepper(self, slope: ca.Function, scale: Array) -> ca.Function:
        """See Integrator.stepper; evaluating it raises RuntimeError where the integrator fails."""
        n, n_d, m, unit = scale.size, slope.size1_in(1), len(self.samples), ca.DM(scale)
        z, t, h = ca.SX.sym("z", n), ca.SX.sym("t"), ca.SX.sym("h")
        d = ca.SX.sym("d", n_d, m)
        rate = h * slope(unit * z, d @ _weights(t)) / unit
        equations = {"x": z, "t": t, "p": ca.vertcat(h, ca.vec(d)), "ode": rate}
        options: dict[str, Any] = {"reltol": self.tolerance, "abstol": self.tolerance}
        across = ca.integrator(
            "across", self.name, equations, 0.0, 1.0, options | dict(self.options)
        )
        x, given, length = ca.MX.sym("x", n), ca.MX.sym("d", n_d, m), ca.MX.sym("h")
        end = across(x0=x / unit, p=ca.vertcat(length, ca.vec(given)))["xf"]
        return ca.Function("step", [x, given, length], [unit * end])


def _weights(t: ca.SX) -> ca.SX:
    """Return what the samples weigh (m,) in their polynomial at t in [0, 1]."""
    z = 2 * t - 1
    chebyshev = [ca.SX(1), z]
    while len(chebyshev) <= _DEGREE:
        chebyshev.append(2 * z * chebyshev[-1] - chebyshev[-2])
    fit = np.linalg.inv(np.polynomial.chebyshev.chebvander(_POINTS, _DEGREE))
    weights: ca.SX = ca.DM(fit.T) @ ca.vertcat(*chebyshev)
    return weights


# Coarser tolerances leave a step or two of order 1 between nodes, whose error they do not rule. At
# refinement 48 they are finer than rounding: tips are good to some 4e-9 of the length at best.
CVODES = Adaptive(
    "cvodes",
    4,
    1e-6,
    (("linear_multistep_method", "adams"), ("nonlinear_solver_iteration", "functional")),
)
# The step from node to node is tried first: steps that grow from a small one hide what a mesh does.
ERK = Adaptive("erk", 5, 1e-2, (("step0", 1.0),))
