"""Gauss collocation: implicit Runge-Kutta schemes of order 2 s in s stages.

Source: E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II: Stiff and
Differential-Algebraic Problems", Springer 1996, section IV.5; points and coefficients are CasADi's.
They keep every quadratic invariant, so quaternions stay of unit length to rounding by construction.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from model.paths import Array

# A step of Newton's method below this, in scaled states, leaves an error of its square.
_SETTLED = 1e-9


@dataclass(frozen=True)
class Gauss:
    """A scheme of an even order.

    Attributes
    ----------
    name : str
    order : int
    """

    name: str
    order: int

    @property
    def samples(self) -> tuple[float, ...]:
        """See Integrator.samples: the Gauss-Legendre points (order / 2,)."""
        return tuple(ca.collocation_points(self.order // 2, "legendre"))

    def refined(self, refinement: int) -> Gauss:
        """See Integrator.refined: the steps are the mesh's."""
        return self

    def stepper(self, slope: ca.Function, scale: Array) -> ca.Function:
        """See Integrator.stepper; evaluating it raises RuntimeError where Newton's method fails."""
        n, m, unit = scale.size, len(self.samples), ca.DM(scale)
        x, d, h = ca.MX.sym("x", n), ca.MX.sym("d", slope.size1_in(1), m), ca.MX.sym("h")
        start = x / unit
        stages, rates = self._stages(slope, unit)
        found = stages(x0=ca.repmat(start, m, 1), p=ca.vertcat(start, ca.vec(d), h))["x"]
        change = rates(found, d) @ ca.collocation_coeff(self.samples)[2]
        return ca.Function("step", [x, d, h], [x + h * unit * change])

    def _stages(self, slope: ca.Function, unit: ca.DM) -> tuple[ca.Function, ca.Function]:
        """Return what finds the scaled stages z (n m,), and (z, d) -> their rates (n, m).

        The polynomial through start and stages has the rates that the equations have there.
        """
        n, m = unit.numel(), len(self.samples)
        start, h, z = ca.SX.sym("start", n), ca.SX.sym("h"), ca.SX.sym("z", n * m)
        d, stages = ca.SX.sym("d", slope.size1_in(1), m), ca.reshape(z, n, m)
        rates = ca.horzcat(*(slope(unit * stages[:, i], d[:, i]) / unit for i in range(m)))
        along = ca.collocation_coeff(self.samples)[0]
        problem = {
            "x": z,
            "p": ca.vertcat(start, ca.vec(d), h),
            "g": ca.vec(ca.horzcat(start, stages) @ along - h * rates),
        }
        options = {"abstol": 0.0, "abstolStep": _SETTLED}
        newton = ca.rootfinder("stages", "fast_newton", problem, options)
        return newton, ca.Function("rates", [z, d], [rates], {"cse": True})


GAUSS4, GAUSS6 = Gauss("gauss4", 4), Gauss("gauss6", 6)
