"""Kernels differentiated along changes of their unknowns: how a shape responds.

Residuals r(y, c) change by r' = r_y dy + r_c dc. Derivatives of that need no chain rule of their
own: with J and H the kernel's Jacobian and the Hessian of lam . r, and ' their derivatives along
(dy, dc),

    Jacobian in (y, dy) = (J', J)        Hessian of lam . r' = (H', H; H, 0),

where J' and H' are one forward derivative of what the kernel has already, instead of its second
and third derivatives anew. Source: Griewank, Walther, "Evaluating derivatives", 2nd ed., 2008,
section 3.1.
"""

from __future__ import annotations

from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from model.transcription.kernel import Kernel, Places


class Tangent(Kernel):
    """The derivative of a kernel along changes of some of its unknowns, and of its numbers.

    Attributes
    ----------
    of : Kernel
    moved : (n_y,) of int
        Place of each unknown's change among all unknowns, which begin with those of `of`; -1 for
        unknowns that stay.
    """

    def __init__(self, name: str, of: Kernel, rows: tuple[int, ...], by_numbers: bool) -> None:
        self.of, n = of, of.y.numel()
        change = ca.SX.sym("change", len(rows))
        numbers = ca.SX.sym("numbers", of.c.numel() * by_numbers)
        self.moved = np.full(n, -1, dtype=np.int64)
        self.moved[list(rows)] = n + np.arange(len(rows))
        self._dy = ca.SX.zeros(n)
        self._dy[list(rows)] = change
        self._dc = numbers if by_numbers else ca.SX.zeros(of.c.numel())
        super().__init__(
            name, ca.vertcat(of.y, change), ca.vertcat(of.c, numbers), self._along(of.r)
        )

    @cached_property
    def jacobian(self) -> tuple[ca.Function, Places, Places]:
        """See Kernel.jacobian: (J', J)."""
        function, i, j = self.of.jacobian
        J = function(self.of.y, self.of.c)
        J_dot, kept = self._changed(J)
        moved = np.flatnonzero(self.moved[j] >= 0)
        rows, columns = np.append(i[kept], i[moved]), np.append(j[kept], self.moved[j[moved]])
        values = ca.vertcat(J_dot, J[moved.tolist()])
        return self._function("jacobian", [self.y, self.c], values), rows, columns

    @cached_property
    def hessian(self) -> tuple[ca.Function, Places, Places]:
        """See Kernel.hessian: (H', H; H, 0)."""
        function, i, j = self.of.hessian
        lam = ca.SX.sym("lam", self.r.numel())
        H = function(self.of.y, self.of.c, lam)
        H_dot, kept = self._changed(H)
        moved = np.flatnonzero(self.moved[j] >= 0)
        across, change, own = H[moved.tolist()], self.moved[j[moved]], i[moved]
        values = ca.vertcat(H_dot, across, across)
        rows, columns = (
            np.concatenate(parts) for parts in ((i[kept], own, change), (j[kept], change, own))
        )
        return self._function("hessian", [self.y, self.c, lam], values), rows, columns

    def _along(self, r: ca.SX) -> ca.SX:
        """Return the derivative of an expression along the changes."""
        return ca.jtimes(r, self.of.y, self._dy) + ca.jtimes(r, self.of.c, self._dc)

    def _changed(self, values: ca.SX) -> tuple[ca.SX, Places]:
        """Return the derivatives of values that may be other than zero, and whose they are."""
        found = ca.sparsify(self._along(values))
        return found.nz[:] if found.nnz() else ca.SX(0, 1), np.array(found.sparsity().row(), int)

    def _function(self, what: str, given: list[ca.SX], values: ca.SX) -> ca.Function:
        """Return a function; what the kernel's own share, their derivatives share already."""
        return ca.Function(f"{self.name}_{what}", given, [ca.densify(values)])


@lru_cache(maxsize=32)
def tangent(kernel: Kernel) -> Tangent:
    """Return the derivative of a kernel along changes of all its unknowns and numbers."""
    every = tuple(range(kernel.y.numel()))
    return Tangent(f"{kernel.name}_tangent", kernel, every, True)


@lru_cache(maxsize=32)
def mode(kernel: Kernel, rows: tuple[int, ...]) -> Tangent:
    """Return the derivative of a kernel along changes of some of its unknowns, by their rows."""
    return Tangent(f"{kernel.name}_mode", kernel, rows, False)
