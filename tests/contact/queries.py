"""Random arms pulled against random obstacles, and a NumPy test of equilibrium of the shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from octoplan.model import Arm, Scene, Shape, settle
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, NeoHookean, Weight
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Box, Capsule, HalfSpace, Sphere
from octoplan.model.extensions.obstacles.base import Obstacle
from octoplan.model.support.errors import OctoplanError
from tests.contact.cases import distance
from tests.core.effects.spatial import EnergyRod, LoadedRod, Loads
from tests.oracles import Array, Rod, paper_rod
from tests.random_arms import DENSITY, random_arm, random_pulls

WATER, G = 1000.0, 9.81
_LOOKS = 300


@dataclass(frozen=True, eq=False)
class Query:
    """An arm, tensions, obstacles in a scene, and the same arm for NumPy.

    `heaviness` is force per volume [N/m3].
    """

    arm: Arm
    scene: Scene
    tensions: Array
    obstacles: tuple[Obstacle, ...]
    rod: Rod
    specific_weight: Array
    rubber: bool


def _unit(rng: np.random.Generator) -> Array:
    found = rng.normal(size=3)
    return np.asarray(found / np.linalg.norm(found))


def _obstacle(L: float, touch: Array, out: Array, rng: np.random.Generator) -> Obstacle:
    """Return an obstacle through a surface point with a given outward normal."""
    size = L * float(np.exp(rng.uniform(np.log(0.03), np.log(0.3))))
    kind = rng.choice(["sphere", "capsule", "box", "half-space"])
    if kind == "sphere":
        return Sphere(tuple(touch - size * out), size)
    if kind == "half-space":
        return HalfSpace(tuple(touch), tuple(out))
    axis = np.cross(out, _unit(rng))
    axis /= np.linalg.norm(axis)
    if kind == "capsule":
        middle, half = touch - size * out, L * rng.uniform(0.05, 0.5)
        middle = middle + axis * half * rng.uniform(-1, 1)
        return Capsule(tuple(middle - half * axis), tuple(middle + half * axis), size)
    frame = np.column_stack([out, axis, np.cross(out, axis)])
    sizes = size * rng.uniform(0.5, 2, 3)
    middle = touch - frame @ (sizes * [0.5, *rng.uniform(-0.5, 0.5, 2)])
    return Box(tuple(middle), tuple(sizes), tuple(map(tuple, frame)))


def query(seed: int) -> Query:
    """Return the query of a seed.

    Obstacles are placed on the free arm, clear of the arm at rest. Queries without such an
    obstacle, or that do not settle alone, are drawn again.
    """
    rng = np.random.default_rng(seed)
    while True:
        name = rng.choice(["table-2", "table-4", "any", "any"])
        arm, rod = (
            random_arm(rng, 1.0, 4, 5) if name == "any" else (Arm.from_paper(name), paper_rod(name))
        )
        kind = rng.choice(["paper", "exact", "exact", "silicone"])
        effects: list[Effect] = [Extension()]
        effects += [ExactTendons()] * (kind != "paper") + [NeoHookean()] * (kind == "silicone")
        heavy = rng.uniform() < 0.3
        if heavy:
            effects += [Weight((0.0, 0.0, -G)), Buoyancy(WATER)]
        T = random_pulls(arm, rng, 1.5)
        try:
            free = settle(arm, T, Scene(*effects), 1e-3)
        except OctoplanError:
            continue
        obstacles = _around(arm, free, int(rng.integers(1, 4)), rng)
        if obstacles:
            scene = Scene(*effects, *map(Contact, obstacles))
            specific_weight = np.array([0, 0, -G]) * (DENSITY - WATER) * heavy
            return Query(arm, scene, T, obstacles, rod, specific_weight, kind == "silicone")


def _around(arm: Arm, free, count: int, rng: np.random.Generator) -> tuple[Obstacle, ...]:  # type: ignore[no-untyped-def]
    """Return obstacles, the first of which is placed on the free arm."""
    L, found = arm.length, list[Obstacle]()
    s = np.linspace(0, L, _LOOKS)
    radius = np.asarray(arm.outer_radius(s)[0])
    rest = np.array(arm.base_position) + np.outer(s, np.array(arm.base_frame)[:, 0])
    bent = free.position(s)
    for _ in range(200):
        at = int(rng.integers(_LOOKS // 4, _LOOKS))
        moved = bent[at] - rest[at]
        far = float(np.linalg.norm(moved))
        out = -moved / max(far, 1e-12) + 0.7 * _unit(rng)
        out /= np.linalg.norm(out)
        depth = far * rng.uniform(0.1, 0.8) if not found else L * rng.uniform(-0.05, 0.3)
        body = _obstacle(L, bent[at] + out * (depth - radius[at]), out, rng)
        if (distance(body, rest) - radius).min() > 1e-3 * L:
            found.append(body)
        if len(found) == count:
            return tuple(found)
    return ()


_SEEN, _CUTS = 2001, 6
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(24)


def complementarity(asked: Query, shape: Shape) -> float:
    """Return the violation of gap >= 0, force >= 0, gap times force = 0, and the lean of forces.

    Gaps are over the arm's length, forces over the largest one.
    """
    L, touches = asked.arm.length, shape.contacts
    s = np.append(np.linspace(0, L, _SEEN), [touch.s for touch in touches])
    x, radius = shape.position(s), np.asarray(asked.rod.radius(s), dtype=float)
    if asked.rubber:
        radius = radius / np.sqrt(1 + shape.strain(s)[:, 3])
    off = [max(0.0, -float((distance(b, x) - radius).min()) / L) for b in asked.obstacles]
    most = max((float(np.linalg.norm(touch.force)) for touch in touches), default=1.0)
    steps = 1e-8 * L * np.eye(3)
    for touch, place, wide in zip(touches, x[_SEEN:], radius[_SEEN:], strict=True):
        off.append(abs(float(distance(touch.obstacle, place[None])[0]) - wide) / L)
        out = distance(touch.obstacle, place + steps) - distance(touch.obstacle, place - steps)
        out /= np.linalg.norm(out)
        off.append(max(0.0, -float(touch.force @ out)) / most)
        # The normal is by differences, across a sharp edge's rounding too.
        lean = float(np.linalg.norm(np.cross(touch.force, out))) / most
        off.append(lean if lean > 1e-4 else 0.0)
    return max(off)


def imbalance(asked: Query, shape: Shape) -> float:
    """Return the difference of strains from the strains of the wrench beyond, over 1 / L or 1.

    The cross-sections are outside of parts that lie on an obstacle.
    """
    rod, L, touches = asked.rod, asked.arm.length, shape.contacts
    lying = [touch.s for touch in touches if touch.pressure]
    cuts = np.linspace(0.05, 0.95, _CUTS) * L
    cuts = cuts[(cuts < min(lying)) | (cuts > max(lying))] if lying else cuts
    at = cuts[:, None] + (L - cuts)[:, None] * (_GAUSS + 1) / 2
    spread = (L - cuts)[:, None] / 2 * _WEIGHTS * np.pi * np.asarray(rod.radius(at)) ** 2
    weight = spread[:, :, None] * asked.specific_weight
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
