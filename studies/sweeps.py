"""Strains integrated from the tip to the base and from the base to the tip, by SciPy alone.

The equations are those of the paper's section 3 for one tendon in a plane, D k' = - D' k + (y T)'
with D = E J + y2 T: an error of k goes with 1 / D, which falls like R^-4 from the tip to the base.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]

# The body of table 4 with the outermost of its tendons, pulled gently.
L, BASE, TIP, E = 0.45, 15e-3, 2e-3, 110e3
OFFSET, END, PULL = 7.5e-3, 1e-3, 1e-2
_OFF, _POINTS = 1e-9, 200


@dataclass(frozen=True, eq=False)
class Sweeps:
    """Errors of curvature times the radius of the base, at arc lengths s (N,) [m].

    Attributes
    ----------
    from_tip, from_base, predicted : (N,)
        Of each way, beginning with 1e-9; and D(base) / D(s) times that.
    up, down, ratio : float
        Error at the end over that at the beginning, either way; D(base) / D(tip).
    """

    s: Array
    from_tip: Array
    from_base: Array
    predicted: Array
    up: float
    down: float
    ratio: float


def _section(s: Array | float) -> tuple[Array, Array, Array, Array]:
    """Return D, its rate, y T and its rate at s."""
    R, y = BASE + (TIP - BASE) * s / L, OFFSET + (END - OFFSET) * s / L
    R_rate, y_rate = (TIP - BASE) / L, (END - OFFSET) / L
    D = E * np.pi * R**4 / 4 + y**2 * PULL
    rate = E * np.pi * R**3 * R_rate + 2 * y * y_rate * PULL
    return np.asarray(D), np.asarray(rate), np.asarray(y * PULL), np.asarray(y_rate * PULL)


def sweeps() -> Sweeps:
    """Return both sweeps, each from the closed form k = y T / D with an error at its beginning."""
    s = np.linspace(0.0, L, _POINTS)
    D, _, moment, _ = _section(s)
    wanted = moment / D

    def rate(x: float, k: Array) -> Array:
        D, D_rate, _, moment_rate = _section(x)
        return (moment_rate - D_rate * k) / D

    def run(begin: float, end: float) -> Array:
        places = s if begin < end else s[::-1]
        start = [np.interp(begin, s, wanted) + _OFF / BASE]
        tight = {"rtol": 1e-13, "atol": 1e-16}
        found = solve_ivp(rate, (begin, end), start, "DOP853", t_eval=places, **tight).y[0]
        return np.asarray(found if begin < end else found[::-1])

    up, down = run(L, 0.0), run(0.0, L)
    from_tip, from_base = np.abs(up - wanted) * BASE, np.abs(down - wanted) * BASE
    return Sweeps(
        s,
        from_tip,
        from_base,
        _OFF * D[0] / D,
        float(from_tip[0] / _OFF),
        float(from_base[-1] / _OFF),
        float(D[0] / D[-1]),
    )
