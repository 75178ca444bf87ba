"""A payload that pulls on a curled arm unrolls the arm, as in a collocation of the same arm."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import TipLoad
from tests.core.effects.cases import Array

ARM, L = Arm.from_paper("table-4"), 0.45
CUTS = np.array([0.0, 0.135, 0.315, 0.45])
# End, offsets at the end and at the base of each section's tendons; tensions of the tendons on n
# and on -n [N].
ROWS = ((0.45, 1e-3, 7.5e-3), (0.315, 3.5e-3, 3.5e-3), (0.135, 6e-3, 6e-3))
PULLS = ((0.0, 0.2), (1.0, 0.0), (0.0, 3.0))
WAYS = {"outward": (1.0, 0.0), "to its side": (0.8, 0.6), "across": (0.6, -0.8)}
PAYLOADS = (0.002, 0.01, 0.03, 0.1, 0.3, 1.0)


def own_bend(s: Array, piece: int) -> tuple[Array, Array]:
    """Moment of the tendons, and EJ + S[y2 T], on one of the pieces between anchorages."""
    R = 15e-3 + (2e-3 - 15e-3) * s / L
    moment, stiffness = np.zeros_like(s), 110e3 * np.pi * R**4 / 4
    for (at, end, base), (one, other) in zip(ROWS, PULLS, strict=True):
        y = (base + (end - base) * s / at) * (CUTS[piece + 1] <= at)
        moment += y * (other - one)  # n is -y in the x-y plane
        stiffness += y**2 * (one + other)
    return moment, stiffness


@cache
def collocated(way: str) -> dict[float, Array]:
    """The tip (x, y) under each payload: pieces side by side, loads applied in small steps."""
    direction = np.array(WAYS[way])

    def solve(size: float, x: Array, guess: Array) -> Any:
        F = size * direction

        def rate(x: Array, y: Array) -> Array:
            rows = []
            for piece in range(3):
                h = CUTS[piece + 1] - CUTS[piece]
                _, _, angle, moment = y[4 * piece : 4 * piece + 4]
                own, stiffness = own_bend(CUTS[piece] + h * x, piece)
                turn = (own + moment) / stiffness
                bend = np.sin(angle) * F[0] - np.cos(angle) * F[1]
                rows += [h * v for v in (np.cos(angle), np.sin(angle), turn, bend)]
            return np.array(rows)

        def joined(a: Array, b: Array) -> Array:
            return np.concatenate([a[:3], b[:4] - a[4:8], b[4:8] - a[8:], b[11:]])

        found = solve_bvp(rate, joined, x, guess, tol=1e-7, max_nodes=20000)
        assert found.success
        return found

    last = solve(0.0, np.linspace(0, 1, 60), np.zeros((12, 60)))
    tips = {}
    for size in sorted([*np.geomspace(3e-4, 1, 8), *PAYLOADS]):
        last = solve(float(size), last.x, last.y)
        tips[float(size)] = last.y[8:10, -1]
    return tips


@pytest.mark.quick("to its side-0.03")
@pytest.mark.parametrize("size", PAYLOADS)
@pytest.mark.parametrize(
    "way", ["outward", "to its side", pytest.param("across", marks=pytest.mark.slow)]
)
def test_a_payload_unrolls_a_curled_arm(way: str, size: float) -> None:
    T = np.zeros((3, 4))
    T[:, [0, 2]] = PULLS
    force = (*(size * np.array(WAYS[way])), 0.0)
    wanted = collocated(way)[size]
    tip = settle(ARM, T, Scene(TipLoad(force)), 1e-8).tip
    assert np.allclose(tip, [*wanted, 0], rtol=0, atol=1e-8 * L)


def test_without_payload_the_arm_is_curled() -> None:
    T = np.zeros((3, 4))
    T[:, [0, 2]] = PULLS
    frame = settle(ARM, T, Scene(), 1e-8).tip_frame
    assert frame[0, 0] < -0.5
