"""Kernels differentiated along changes of their unknowns and numbers: of responses and modes."""

from __future__ import annotations

import casadi as ca
import numpy as np

from model.machine.functions import built
from model.transcription.kernels import Kernel, Places, What


class Tangent(Kernel):
    """The derivative of a kernel along changes of some of its unknowns, and of its numbers.

    Attributes
    ----------
    of : Kernel
    change_of : (n_y,) of int
        Place of each unknown's change among all unknowns, which begin with those of `of`; -1 for
        unknowns that stay.
    """

    def __init__(self, name: str, of: Kernel, rows: tuple[int, ...], by_numbers: bool) -> None:
        self.of, n = of, of.y.numel()
        change = ca.SX.sym("change", len(rows))
        numbers = ca.SX.sym("numbers", of.c.numel() * by_numbers)
        self.change_of = np.full(n, -1, dtype=np.int64)
        self.change_of[list(rows)] = n + np.arange(len(rows))
        self._dy = ca.SX.zeros(n)
        self._dy[list(rows)] = change
        self._dc = numbers if by_numbers else ca.SX.zeros(of.c.numel())
        super().__init__(
            name, ca.vertcat(of.y, change), ca.vertcat(of.c, numbers), self._along(of.r)
        )

    def _differentiated(self, what: What) -> tuple[ca.Function, Places, Places]:
        """See Kernel: (J', J), r', and (H', H; H, 0)."""
        if what == "by_numbers":
            return super()._differentiated(what)
        lam, symmetric = ca.SX.sym("lam", self.r.numel()), what == "hessian"
        function, i, j = self.of.derivative(what)
        whole = function.call([self.of.y, self.of.c, lam][: 2 + symmetric])[0]
        changed = ca.sparsify(self._along(whole))
        kept = np.array(changed.sparsity().row(), dtype=np.int64)
        also = np.flatnonzero(self.change_of[j] >= 0)
        across, change = whole[also.tolist()], self.change_of[j[also]]
        rows, columns = [i[kept], i[also]], [j[kept], change]
        values = [ca.vec(changed.nz[:]), across]
        if symmetric:
            rows, columns, values = [*rows, change], [*columns, i[also]], [*values, across]
        inputs = [self.y, self.c, lam][: 2 + symmetric]
        # What the kernel's own share, their derivatives share already.
        results = [ca.densify(ca.vertcat(*values)), *[self.r] * (what == "jacobian")]
        result = ca.Function(f"{self.name}_{what}", inputs, results)
        return result, np.concatenate(rows), np.concatenate(columns)

    def _along(self, r: ca.SX) -> ca.SX:
        """Return the derivative of an expression along the changes."""
        return ca.jtimes(r, self.of.y, self._dy) + ca.jtimes(r, self.of.c, self._dc)


def tangent(kernel: Kernel) -> Tangent:
    """Return the derivative of a kernel along changes of all its unknowns and numbers."""
    every = tuple(range(kernel.y.numel()))
    return built(Tangent, f"{kernel.name}_tangent", kernel, every, True)


def mode(kernel: Kernel, rows: tuple[int, ...]) -> Tangent:
    """Return the derivative of a kernel along changes of some of its unknowns, by their rows."""
    return built(Tangent, f"{kernel.name}_mode", kernel, rows, False)
