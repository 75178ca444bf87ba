"""Whether a settled shape is an equilibrium with contact: by NumPy, from what is read off it."""

from __future__ import annotations

import numpy as np

from model import Shape
from model.effects import ExactTendons
from tests.contact.cases import distance
from tests.contact.queries import Query
from tests.effects.spatial import EnergyRod, LoadedRod, Loads

_LOOKS, _CUTS = 2001, 6
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(24)


def complementarity(asked: Query, shape: Shape) -> float:
    """Return by how much gap >= 0, force >= 0, gap times force = 0 fail, or forces lean.

    Gaps over the arm's length, forces over the largest.
    """
    L, touches = asked.arm.length, shape.contacts
    s = np.append(np.linspace(0, L, _LOOKS), [touch.s for touch in touches])
    x, radius = shape.position(s), np.asarray(asked.rod.radius(s), dtype=float)
    if asked.rubber:
        radius = radius / np.sqrt(1 + shape.strain(s)[:, 3])
    off = [max(0.0, -float((distance(b, x) - radius).min()) / L) for b in asked.obstacles]
    most = max((float(np.linalg.norm(touch.force)) for touch in touches), default=1.0)
    steps = 1e-8 * L * np.eye(3)
    for touch, place, wide in zip(touches, x[_LOOKS:], radius[_LOOKS:], strict=True):
        off.append(abs(float(distance(touch.obstacle, place[None])[0]) - wide) / L)
        out = distance(touch.obstacle, place + steps) - distance(touch.obstacle, place - steps)
        out /= np.linalg.norm(out)
        off.append(max(0.0, -float(touch.force @ out)) / most)
        # The normal is by differences, across a sharp edge's rounding too.
        lean = float(np.linalg.norm(np.cross(touch.force, out))) / most
        off.append(lean if lean > 1e-4 else 0.0)
    return max(off)


def imbalance(asked: Query, shape: Shape) -> float:
    """Return how far strains are from those that the wrench beyond asks for, over 1 / L or 1.

    At cross-sections that no part touches that lies on an obstacle.
    """
    rod, L, touches = asked.rod, asked.arm.length, shape.contacts
    lying = [touch.s for touch in touches if touch.pressure]
    cuts = np.linspace(0.05, 0.95, _CUTS) * L
    cuts = cuts[(cuts < min(lying)) | (cuts > max(lying))] if lying else cuts
    at = cuts[:, None] + (L - cuts)[:, None] * (_GAUSS + 1) / 2
    spread = (L - cuts)[:, None] / 2 * _WEIGHTS * np.pi * np.asarray(rod.radius(at)) ** 2
    weight = spread[:, :, None] * asked.heaviness
    line = shape.position(at.ravel()).reshape(*at.shape, 3)
    s = np.array([touch.s for touch in touches])
    loads = np.array([touch.force for touch in touches]).reshape(-1, 3)
    places, x = shape.position(s) if s.size else np.zeros((0, 3)), shape.position(cuts)
    T = np.ravel(shape.tensions)
    own: LoadedRod = LoadedRod(rod, T, Loads())
    if asked.scene.has(ExactTendons):
        own = EnergyRod(rod, T, Loads(), rubber=asked.rubber)
    worst = 0.0
    for k, (cut, frame, found) in enumerate(
        zip(cuts, shape.frame(cuts), shape.strain(cuts), strict=True)
    ):
        beyond = s > cut
        F = loads[beyond].sum(axis=0) + weight[k].sum(axis=0)
        M = np.cross(places[beyond] - x[k], loads[beyond]).sum(axis=0)
        M = M + np.cross(line[k] - x[k], weight[k]).sum(axis=0)
        omega, nu = own.strains(float(cut), frame, F, M, rod.active(float(cut)))
        off = np.append(L * (found[:3] - omega), found[3] + 1 - nu[0])
        worst = max(worst, float(np.abs(off).max()))
    return worst
