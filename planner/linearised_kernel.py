"""Directional derivatives of kernels, whose directions are further unknowns.

With r(y, c) a kernel, its linearised kernel is r'(y, dy, c, dc) = dr/dy dy + dr/dc dc.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from octoplan.model.rod.kernels import Kernel, Places, What
from octoplan.model.support.machine.functions import cached


class LinearisedKernel(Kernel):
    """The derivative of a kernel along changes of some unknowns, and of the parameters.

    Attributes
    ----------
    kernel : Kernel
        The kernel r(y, c).
    change_of : (n_y,) of int
        Place of the change of each unknown among all unknowns, which begin with y; -1 for unknowns
        that do not change.
    """

    def __init__(
        self, name: str, kernel: Kernel, changing: tuple[int, ...], parameters_change: bool
    ) -> None:
        self.kernel = kernel
        n = kernel.y.numel()
        dy = ca.SX.sym("dy", len(changing))
        dc = ca.SX.sym("dc", kernel.c.numel() * parameters_change)
        self.change_of = np.full(n, -1, dtype=np.int64)
        self.change_of[list(changing)] = n + np.arange(len(changing))
        self._dy = ca.SX.zeros(n)
        self._dy[list(changing)] = dy
        self._dc = dc if parameters_change else ca.SX.zeros(kernel.c.numel())
        y = ca.vertcat(kernel.y, dy)
        parameters = kernel.parameters | {"dc": dc}
        super().__init__(name, y, parameters, self._directional_derivative(kernel.r))

    def _differentiated(self, what: What) -> tuple[ca.Function, Places, Places]:
        """See Kernel. With the kernel's J and H: (J', J) and r', or ((H', H), (H, 0))."""
        if what == "parameter_jacobian":
            return super()._differentiated(what)
        is_hessian = what == "hessian"
        lam = ca.SX.sym("lam", self.r.numel())
        function, i, j = self.kernel.derivative(what)
        nonzeros = function.call([self.kernel.y, self.kernel.c, lam][: 2 + is_hessian])[0]
        rates = ca.sparsify(self._directional_derivative(nonzeros))
        changed = np.array(rates.sparsity().row(), dtype=np.int64)
        mixed = np.flatnonzero(self.change_of[j] >= 0)
        mixed_values = nonzeros[mixed.tolist()]
        change = self.change_of[j[mixed]]
        rows = [i[changed], i[mixed]]
        columns = [j[changed], change]
        values = [ca.vec(rates.nz[:]), mixed_values]
        if is_hessian:
            rows.append(change)
            columns.append(i[mixed])
            values.append(mixed_values)
        inputs = [self.y, self.c, lam][: 2 + is_hessian]
        # Kernel and derivatives share common subexpressions already.
        results = [ca.densify(ca.vertcat(*values)), *[self.r] * (what == "jacobian")]
        derivative = ca.Function(f"{self.name}_{what}", inputs, results)
        return derivative, np.concatenate(rows), np.concatenate(columns)

    def _directional_derivative(self, expression: ca.SX) -> ca.SX:
        by_unknowns = ca.jtimes(expression, self.kernel.y, self._dy)
        return by_unknowns + ca.jtimes(expression, self.kernel.c, self._dc)


def linearised(kernel: Kernel) -> LinearisedKernel:
    """Return the derivative of a kernel along changes of all unknowns and parameters."""
    every = tuple(range(kernel.y.numel()))
    return cached(LinearisedKernel, f"{kernel.name}_linearised", kernel, every, True)


def linearised_in(kernel: Kernel, changing: tuple[int, ...]) -> LinearisedKernel:
    """Return the derivative of a kernel along changes of the unknowns at some places."""
    return cached(LinearisedKernel, f"{kernel.name}_mode", kernel, changing, False)
