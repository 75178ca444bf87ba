"""Random arms pulled against one to three random obstacles, most of which they touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model import Arm, Scene, settle
from model.effects import Buoyancy, Contact, Effect, ExactTendons, Extension, NeoHookean, Weight
from model.errors import OctoplanError
from model.obstacles import Box, Capsule, HalfSpace, Obstacle, Sphere
from tests.contact.cases import distance
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
    heaviness: Array
    rubber: bool


def _unit(rng: np.random.Generator) -> Array:
    found = rng.normal(size=3)
    return np.asarray(found / np.linalg.norm(found))


def _obstacle(L: float, touch: Array, out: Array, rng: np.random.Generator) -> Obstacle:
    """Return an obstacle of whose surface a point is given, with the normal out of it."""
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

    Obstacles stand where the free arm would be, clear of the arm at rest. What no obstacle is found
    for, or does not settle alone, is drawn again.
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
            heaviness = np.array([0, 0, -G]) * (DENSITY - WATER) * heavy
            return Query(arm, scene, T, obstacles, rod, heaviness, kind == "silicone")


def _around(arm: Arm, free, count: int, rng: np.random.Generator) -> tuple[Obstacle, ...]:  # type: ignore[no-untyped-def]
    """Return obstacles, the first of them where the free arm would be."""
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
