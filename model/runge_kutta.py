"""Explicit Runge-Kutta schemes, as tableaus and the one step they share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class RungeKutta:
    """An explicit scheme of s stages.

    Attributes
    ----------
    name : str
    order : int
    nodes : (s,)
        c_i; stages that share a node share the numbers of the cross-section there.
    weights : (s,)
        b_i.
    rows : s tuples
        a_ij, j < i.
    """

    name: str
    order: int
    nodes: tuple[float, ...]
    weights: tuple[float, ...]
    rows: tuple[tuple[float, ...], ...]

    def step(self, rate: Callable[[int, ca.SX], ca.SX], x: ca.SX, h: ca.SX) -> ca.SX:
        """Return x after a step h of x' = rate(stage number, x)."""
        slopes: list[ca.SX] = []
        for i, row in enumerate(self.rows):
            inner = x
            for a, slope in zip(row, slopes, strict=True):
                inner = inner + h * a * slope if a else inner
            slopes.append(rate(i, inner))
        for b, slope in zip(self.weights, slopes, strict=True):
            x = x + h * b * slope if b else x
        return x


RK4 = RungeKutta(
    "rk4",
    4,
    (0, 1 / 2, 1 / 2, 1),
    (1 / 6, 1 / 3, 1 / 3, 1 / 6),
    ((), (1 / 2,), (0, 1 / 2), (0, 0, 1)),
)

# J. C. Butcher, "On Runge-Kutta processes of high order", J. Austral. Math. Soc. 4 (1964): order 6
# in seven stages.
RK6 = RungeKutta(
    "rk6",
    6,
    (0, 1 / 3, 2 / 3, 1 / 3, 1 / 2, 1 / 2, 1),
    (11 / 120, 0, 27 / 40, 27 / 40, -4 / 15, -4 / 15, 11 / 120),
    (
        (),
        (1 / 3,),
        (0, 2 / 3),
        (1 / 12, 1 / 3, -1 / 12),
        (-1 / 16, 9 / 8, -3 / 16, -3 / 8),
        (0, 9 / 8, -3 / 8, -3 / 4, 1 / 2),
        (9 / 44, -9 / 11, 63 / 44, 18 / 11, 0, -16 / 11),
    ),
)
