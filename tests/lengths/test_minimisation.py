"""Settles by lengths are the shape of least energy of an independent minimisation by SciPy.

Strains are polynomials, lengths inequalities; the oracle does not import the project. Per unit
reference length kappa and lambda, c = lambda t + y' d + y kappa x d; energy EA (lambda - 1)^2 / 2 +
EJ (kappa_n^2 + kappa_b^2) / 2 + GI kappa_t^2 / 2, minus the work of a dead force at the tip.
Derivatives are by complex steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy.optimize import minimize

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, TipLoad
from octoplan.model.tendons import rest_lengths
from tests.oracles import Array

_DEGREE, _STEPS = 5, 12
_TINY = 1e-30


@dataclass(frozen=True)
class Cone:
    """A cone with four tendons a section.

    Attributes
    ----------
    ends : tuple of float
        Of the sections, from base to tip [m]; the last is the length.
    radii, offsets : (2,), (sections, 2)
        At base and end [m].
    E, nu : float
    frame : (3, 3)
        Columns t, n, b at the base.
    force : (3,)
        At the tip [N].
    """

    ends: tuple[float, ...]
    radii: tuple[float, float]
    offsets: tuple[tuple[float, float], ...]
    E: float
    nu: float
    frame: Array
    force: Array

    def least(self, lengths: Array) -> tuple[Array, Array, float]:
        """Return tip (3,), tendons' lengths (4 sections,) and energy of the least shape.

        Tendons are in the order of sections, base to tip.
        """
        n = len(self.ends) * (_DEGREE + 1) * 4
        scale = np.tile([1 / self.ends[-1]] * 3 + [0.1], n // 4)
        EJ = self.E * np.pi * self.radii[0] ** 4 / 4
        unit = EJ / self.ends[-1]
        zero = np.zeros(n)

        def energy(x: Array) -> tuple[float, Array]:
            value, slope = _derived(lambda z: self._energy(z * scale) / unit, x)
            return float(value[0]), slope[0]

        def left(x: Array) -> Array:
            return (lengths - np.real(self._lengths(x[None] * scale + 0j))[0]) / self.ends[-1]

        def left_jacobian(x: Array) -> Array:
            return -_derived(lambda z: self._lengths(z * scale), x)[1] / self.ends[-1]

        held = {"type": "ineq", "fun": left, "jac": left_jacobian}
        found = minimize(
            energy,
            zero,
            jac=True,
            method="SLSQP",
            constraints=[held],
            options={"ftol": 1e-15, "maxiter": 500},
        )
        x = found.x[None] * scale + 0j
        return np.real(self._march(x))[0], np.real(self._lengths(x))[0], float(found.fun * unit)

    def _strains(self, x: NDArray[np.complex128], i: int, at: Array) -> NDArray[np.complex128]:
        """Return kappa_t, kappa_n, kappa_b, lambda (m, N, 4) of section i at places in [-1, 1]."""
        own = x.reshape(len(x), len(self.ends), _DEGREE + 1, 4)[:, i]
        found = np.einsum("nk,mkj->mnj", legvander(at, _DEGREE), own)
        found[:, :, 3] += 1
        return found

    def _energy(self, x: NDArray[np.complex128]) -> NDArray[np.complex128]:
        total = np.zeros(len(x), complex)
        for i, (begin, end) in enumerate(zip((0.0, *self.ends), self.ends, strict=False)):
            at, weight = np.polynomial.legendre.leggauss(2 * _DEGREE)
            s = begin + (at + 1) / 2 * (end - begin)
            R = self.radii[0] + (self.radii[1] - self.radii[0]) * s / self.ends[-1]
            EA, EJ = self.E * np.pi * R**2, self.E * np.pi * R**4 / 4
            v = self._strains(x, i, at)
            density = EA * (v[:, :, 3] - 1) ** 2 + EJ * (v[:, :, 1] ** 2 + v[:, :, 2] ** 2)
            density += EJ / (1 + self.nu) * v[:, :, 0] ** 2
            total += density @ weight * (end - begin) / 4
        return (total - self._march(x) @ self.force)[:, None]

    def _lengths(self, x: NDArray[np.complex128]) -> NDArray[np.complex128]:
        total = np.zeros((len(x), len(self.ends), 4), complex)
        for i, (begin, end) in enumerate(zip((0.0, *self.ends), self.ends, strict=False)):
            at, weight = np.polynomial.legendre.leggauss(2 * _DEGREE)
            s = begin + (at + 1) / 2 * (end - begin)
            v = self._strains(x, i, at)
            for k in range(i, len(self.ends)):
                first, last = self.offsets[k]
                rate = (last - first) / self.ends[k]
                y = first + rate * s
                for j, (cos, sin) in enumerate(((1, 0), (0, 1), (-1, 0), (0, -1))):
                    along = v[:, :, 3] + y * (v[:, :, 1] * sin - v[:, :, 2] * cos)
                    c = (
                        along,
                        rate * cos - y * v[:, :, 0] * sin,
                        rate * sin + y * v[:, :, 0] * cos,
                    )
                    length = np.sqrt(c[0] ** 2 + c[1] ** 2 + c[2] ** 2)
                    total[:, k, j] += length @ weight * (end - begin) / 2
        return total.reshape(len(x), -1)

    def _march(self, x: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the tips (m, 3) by steps of fourth order on the group of motions."""
        m = len(x)
        R = np.repeat(self.frame[None].astype(complex), m, axis=0)
        u, root = np.zeros((m, 3), complex), np.sqrt(3) / 6
        for i, (begin, end) in enumerate(zip((0.0, *self.ends), self.ends, strict=False)):
            h = (end - begin) / _STEPS
            for k in range(_STEPS):
                at = 2 * (k + np.array([0.5 - root, 0.5 + root])) / _STEPS - 1
                v = self._strains(x, i, at)
                A, B = _motion(v[:, 0]), _motion(v[:, 1])
                step = h / 2 * (A + B) + np.sqrt(3) / 12 * h**2 * (A @ B - B @ A)
                g = _exponential(step)
                u = u + np.einsum("mij,mj->mi", R, g[:, :3, 3])
                R = R @ g[:, :3, :3]
        return u


def _motion(v: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the generators (m, 4, 4) of motions along t with strains v (m, 4)."""
    found = np.zeros((len(v), 4, 4), complex)
    t, n, b = v[:, 0], v[:, 1], v[:, 2]
    found[:, 0, 1], found[:, 0, 2], found[:, 1, 2] = -b, n, -t
    found[:, 1, 0], found[:, 2, 0], found[:, 2, 1] = b, -n, t
    found[:, 0, 3] = v[:, 3]
    return found


def _exponential(A: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the exponentials (m, 4, 4) by the series, for small matrices."""
    total = term = np.repeat(np.eye(4, dtype=complex)[None], len(A), axis=0)
    for k in range(1, 13):
        term = term @ A / k
        total = total + term
    return total


def _derived(
    function: Callable[[NDArray[np.complex128]], NDArray[np.complex128]], x: Array
) -> tuple[Array, Array]:
    """Return values (k,) at x (n,), and their derivatives (k, n)."""
    found = function(x[None] + 1j * _TINY * np.eye(x.size))
    return np.real(found[0]), np.imag(found).T / _TINY


FRAME = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])


def test_the_shape_is_of_least_energy(deviation: Callable[..., float]) -> None:
    check_least(1, deviation)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_many_shapes_are_of_least_energy(seed: int, deviation: Callable[..., float]) -> None:
    check_least(seed, deviation)


def check_least(seed: int, deviation: Callable[..., float]) -> None:
    """Assert that a random arm with random lengths and a payload agrees with SciPy."""
    rng = np.random.default_rng(seed)
    ends = (0.12, 0.2)
    radii = rng.uniform(7e-3, 9e-3), rng.uniform(5e-3, 7e-3)
    offsets = tuple((rng.uniform(4e-3, 6e-3), rng.uniform(2e-3, 5e-3)) for _ in ends)
    E = rng.uniform(1e5, 3e5)
    force: Array = rng.normal(0, 0.5 * E * np.pi * radii[1] ** 4 / 4 / ends[-1] ** 2, 3)
    sections = tuple(
        Anchorage(at, Linear(*offset)) for at, offset in zip(ends, offsets, strict=True)
    )[::-1]
    arm = Arm(ends[-1], Linear(*radii), sections, Material(E, 0.45))
    lengths = rest_lengths(arm) * (1 + rng.uniform(-0.03, 0.03, 8))
    scene = Scene(Extension(), ExactTendons(), TipLoad(tuple(force.tolist())))
    shape = settle(arm, scene=scene, accuracy=1e-8, lengths=lengths)
    order = np.r_[4:8, 0:4]
    cone = Cone(ends, radii, offsets, E, 0.45, FRAME, force)
    tip, found, _ = cone.least(lengths[order])
    assert deviation(shape.tip, tip, arm.length) <= 1e-6
    assert shape.tendon_lengths[order] == pytest.approx(found, abs=1e-6 * arm.length)
