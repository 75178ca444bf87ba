"""Contact is the limit of stiff springs: a loaded rod of NumPy and SciPy only.

The oracle is an inextensible rod that bends and twists, clamped along x, under a dead force at its
tip. A part inside of a sphere or a half-space by d is pressed back by k d^2 per length, and the tip
by another spring. As k grows the solution becomes contact. Solved as a boundary value problem by
collocation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from octoplan.model import Scene, settle
from octoplan.model.effects import TipLoad
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import HalfSpace, Sphere
from tests.contact.cases import bar
from tests.oracles import Array


@dataclass(frozen=True)
class Ball:
    """A sphere."""

    center: tuple[float, float, float]
    radius: float

    def gap(self, x: Array) -> tuple[Array, Array]:
        """Return distances (N,) and normals (3, N) at points (3, N)."""
        off = x - np.array(self.center)[:, None]
        far = np.linalg.norm(off, axis=0)
        return far - self.radius, off / far


@dataclass(frozen=True)
class Wall:
    """All that is behind a plane."""

    point: tuple[float, float, float]
    normal: tuple[float, float, float]

    def gap(self, x: Array) -> tuple[Array, Array]:
        """Return distances (N,) and normals (3, N) at points (3, N)."""
        n = np.array(self.normal)
        return n @ (x - np.array(self.point)[:, None]), np.repeat(n[:, None], x.shape[1], axis=1)


@dataclass(frozen=True)
class PenaltyRod:
    """A round rod, the force at its tip, and its obstacle."""

    length: float
    radius: float
    E: float
    nu: float
    force: tuple[float, float, float]
    bodies: tuple[Ball | Wall, ...]

    def settle(self, stiffest: float, softest: float = 1e4) -> tuple[Array, list[Array]]:
        """Return the tip (3,), and the force of each body (3,), from springs that grow."""
        s = np.linspace(0, self.length, 101)
        y = np.zeros((13, s.size))
        y[0], y[3] = s, 1.0
        k = softest
        while k <= 1.001 * stiffest:
            for share in (0.3, 0.6, 1.0) if k == softest else (1.0,):
                found = solve_bvp(
                    lambda s, y, k=k: self._rate(y, k),
                    lambda a, b, k=k, share=share: self._ends(a, b, k, share),
                    s,
                    y,
                    tol=1e-5,
                    max_nodes=20000,
                )
                assert found.success, found.message
                s, y = found.x, found.y
            k *= _STEP
        fine = np.unique(np.concatenate([s, *((s[:-1] + x * np.diff(s)) for x in _INSIDE)]))
        y = found.sol(fine)
        k /= _STEP
        along = [np.trapezoid(self._pressed(y[:3], body, k), fine) for body in self.bodies]
        at_tip = [self._at_tip(y[:3, -1], body, k) for body in self.bodies]
        return np.asarray(y[:3, -1]), [a + b for a, b in zip(along, at_tip, strict=True)]

    def _at_tip(self, x: Array, body: Ball | Wall, k: float) -> Array:
        gap, normal = body.gap(x[:, None])
        return np.asarray(_TIP * k * max(self.radius - float(gap[0]), 0.0) * normal[:, 0])

    def _pressed(self, x: Array, body: Ball | Wall, k: float) -> Array:
        gap, normal = body.gap(x)
        return np.asarray(k * np.maximum(self.radius - gap, 0) ** 2 * normal)

    def _rate(self, y: Array, k: float) -> Array:
        q, M, F = y[3:7], y[7:10], y[10:13]
        w, a, b, c = q
        frame = np.array(
            [
                [w * w + a * a - b * b - c * c, 2 * (a * b - w * c), 2 * (a * c + w * b)],
                [2 * (a * b + w * c), w * w - a * a + b * b - c * c, 2 * (b * c - w * a)],
                [2 * (a * c - w * b), 2 * (b * c + w * a), w * w - a * a - b * b + c * c],
            ]
        )
        EJ = self.E * np.pi * self.radius**4 / 4
        stiff = np.array([EJ / (1 + self.nu), EJ, EJ])[:, None]
        kappa = np.einsum("jin,jn->in", frame, M) / stiff
        t = frame[:, 0]
        scalar = -(q[1:] * kappa).sum(axis=0)
        vector = w * kappa + np.cross(q[1:], kappa, axis=0)
        turn = np.vstack([scalar, vector]) / 2
        f = sum((self._pressed(y[:3], body, k) for body in self.bodies), np.zeros_like(F))
        return np.vstack([t, turn, -np.cross(t, F, axis=0), -f])

    def _ends(self, base: Array, tip: Array, k: float, share: float) -> Array:
        force = share * np.array(self.force)
        force = sum((self._at_tip(tip[:3], body, k) for body in self.bodies), force)
        clamp = base[:7] - np.array([0, 0, 0, 1.0, 0, 0, 0])
        return np.concatenate([clamp, tip[7:10], tip[10:13] - force])


# Places between nodes at which springs act, growth of the springs, and the spring of the tip over k
# [m].
_INSIDE, _STEP, _TIP = (0.25, 0.5, 0.75), 10**0.5, 1e-3


LENGTH, RADIUS, E = 0.3, 0.006, 2e7


def _limit(values: list[Array]) -> Array:
    """Return the limit of a sequence with steps in geometric progression (Aitken)."""
    first, second, third = values
    before, after = second - first, third - second
    safe = np.where(np.abs(before - after) > 1e-12, before - after, 1.0)
    return np.asarray(third + after**2 / safe)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force", "ball", "wall"),
    [
        pytest.param(
            (0.0, 0.12, -0.25),
            Ball((0.15, 0.0, -0.05), 0.03),
            Wall((0.3, 0.03, 0.0), (0.0, -1.0, 0.0)),
            id="a ball, and a wall at the tip",
        ),
        pytest.param(
            (0.0, -0.2, 0.1),
            Ball((0.12, -0.08, 0.01), 0.06),
            Wall((0.3, 0.0, 0.02), (0.0, 0.0, -1.0)),
            id="a wide ball from the side, and a ceiling",
        ),
    ],
)
def test_springs_that_grow_come_to_contact(
    force: tuple[float, float, float], ball: Ball, wall: Wall
) -> None:
    bodies = Sphere(ball.center, ball.radius), HalfSpace(wall.point, wall.normal)
    scene = Scene(TipLoad(force=force), *map(Contact, bodies))
    shape = settle(bar(LENGTH, RADIUS, E), np.zeros(4), scene, 1e-8)
    wanted = [
        sum((t.force for t in shape.contacts if t.obstacle == body), np.zeros(3)) for body in bodies
    ]
    assert all(np.linalg.norm(own) > 0.01 for own in wanted)
    rod = PenaltyRod(LENGTH, RADIUS, E, 0.5, force, (ball, wall))
    found = [rod.settle(k) for k in (1e6, 1e7, 1e8)]
    off = [float(np.linalg.norm(tip - shape.tip)) for tip, _ in found]
    assert off[1] < 0.5 * off[0]
    assert off[2] < 0.5 * off[1]
    tip = _limit([own for own, _ in found])
    assert np.linalg.norm(tip - shape.tip) < 1e-3 * LENGTH
    for j, own in enumerate(wanted):
        loads = [load[j] for _, load in found]
        off = [float(np.linalg.norm(load - own)) for load in loads]
        assert off[2] < 0.6 * off[1] < 0.36 * off[0]
        assert np.linalg.norm(_limit(loads) - own) < min(off[2], 0.03 * np.linalg.norm(own))
