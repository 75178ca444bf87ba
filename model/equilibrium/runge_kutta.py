"""Explicit Runge-Kutta methods for rates along the arm, in symbols or numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import casadi as ca

from octoplan.model.paths import Array

X = TypeVar("X", ca.SX, Array)


@dataclass(frozen=True)
class RungeKutta:
    """An explicit Runge-Kutta method of s stages.

    Attributes
    ----------
    name : str
    order : int
    nodes : (s,)
        c_i; stages with the same node share the numbers of the cross-section.
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

    def step(self, rate: Callable[[int, X], X], x: X, h: Any) -> X:
        """Return x after a step h of x' = rate(stage number, x), in symbols or numbers."""
        slopes: list[X] = []
        for i, row in enumerate(self.rows):
            inner = x
            for a, slope in zip(row, slopes, strict=True):
                inner = inner + h * a * slope if a else inner
            slopes.append(rate(i, inner))
        for b, slope in zip(self.weights, slopes, strict=True):
            x = x + h * b * slope if b else x
        return x

    @property
    def samples(self) -> tuple[float, ...]:
        """The distinct nodes, in order."""
        return tuple(sorted(set(self.nodes)))


# G. J. Cooper, J. H. Verner, "Some explicit Runge-Kutta methods of high order", SIAM J. Numer.
# Anal. 9 (1972): order 8 in eleven stages.
_R = 21**0.5
RK8 = RungeKutta(
    "rk8",
    8,
    (
        0,
        1 / 2,
        1 / 2,
        (7 + _R) / 14,
        (7 + _R) / 14,
        1 / 2,
        (7 - _R) / 14,
        (7 - _R) / 14,
        1 / 2,
        (7 + _R) / 14,
        1,
    ),
    (1 / 20, 0, 0, 0, 0, 0, 0, 49 / 180, 16 / 45, 49 / 180, 1 / 20),
    (
        (),
        (1 / 2,),
        (1 / 4, 1 / 4),
        (1 / 7, (-7 - 3 * _R) / 98, (21 + 5 * _R) / 49),
        ((11 + _R) / 84, 0, (18 + 4 * _R) / 63, (21 - _R) / 252),
        ((5 + _R) / 48, 0, (9 + _R) / 36, (-231 + 14 * _R) / 360, (63 - 7 * _R) / 80),
        (
            (10 - _R) / 42,
            0,
            (-432 + 92 * _R) / 315,
            (633 - 145 * _R) / 90,
            (-504 + 115 * _R) / 70,
            (63 - 13 * _R) / 35,
        ),
        (1 / 14, 0, 0, 0, (14 - 3 * _R) / 126, (13 - 3 * _R) / 63, 1 / 9),
        (
            1 / 32,
            0,
            0,
            0,
            (91 - 21 * _R) / 576,
            11 / 72,
            (-385 - 75 * _R) / 1152,
            (63 + 13 * _R) / 128,
        ),
        (
            1 / 14,
            0,
            0,
            0,
            1 / 9,
            (-733 - 147 * _R) / 2205,
            (515 + 111 * _R) / 504,
            (-51 - 11 * _R) / 56,
            (132 + 28 * _R) / 245,
        ),
        (
            0,
            0,
            0,
            0,
            (-42 + 7 * _R) / 18,
            (-18 + 28 * _R) / 45,
            (-273 - 53 * _R) / 72,
            (301 + 53 * _R) / 72,
            (28 - 28 * _R) / 45,
            (49 - 7 * _R) / 18,
        ),
    ),
)
