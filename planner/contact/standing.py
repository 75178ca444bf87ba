"""How well an arm in contact stands, as a term of a program in the tensions.

s |s| / m - m >= 0 with the stability s, see model.contact.stability, and the least m of it: the
square of s goes down to 0 straight where an arm is about to snap, as s does not.
"""

from __future__ import annotations

import numpy as np

from model.contact.stability import held_stability
from model.contact.touches import Touches
from model.errors import OctoplanError
from model.paths import Array
from planner.contact.equilibria import Equilibria, Found

# Steps of differences in units of tensions; up to this many times the least its slope counts.
_STEP, _NEAR = 1e-6, 4.0


def standing(own: Equilibria, found: Found, least: float, units: Array) -> tuple[Array, Array]:
    """Return the term (1,) at an equilibrium, and its derivatives (1, n_tendons) by tensions [1/N].

    By differences over units of tensions (n_tendons,) [N], without contact coming or going; 0 where
    the arm stands so well that nothing holds it.
    """
    stability, slope = held_stability(found[0]), np.zeros(units.size)
    square = stability * abs(stability)
    if stability < _NEAR * least:
        for i, h in enumerate(_STEP * units):
            for step in (h, -h):
                there = _square(own, found[0].tensions + step * np.eye(units.size)[i], found)
                if there is not None:
                    slope[i] = (there - square) / step
                    break
    return np.array([square / least - least]), slope[None] / least


def _square(own: Equilibria, tensions: Array, near: Found) -> float | None:
    """Return s |s| at tensions; None where something else touches there, or the arm snaps."""
    try:
        there = own.at(tensions, near)[0]
    except OctoplanError:
        return None
    if not Touches.of(there.system).like(Touches.of(near[0].system)):
        return None
    stability = held_stability(there)
    return stability * abs(stability)
