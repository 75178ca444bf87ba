"""Random arms pulled against one to three random obstacles, most of which they touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model import Anchorage, Arm, Linear, Material, Scene, settle
from model.effects import Buoyancy, Contact, Effect, ExactTendons, Extension, NeoHookean, Weight
from model.errors import OctoplanError
from model.obstacles import Box, Capsule, HalfSpace, Obstacle, Sphere
from tests.contact.bodies import distance
from tests.oracles import Array, Rod, RodSection, linear, paper_rod

DENSITY, WATER, G = 1080.0, 1000.0, 9.81
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


def _arm(rng: np.random.Generator) -> tuple[Arm, Rod]:
    """Return an arm of the paper's, or one of 1 to 4 anchorages, 5 cm to 1 m long."""
    kind = rng.choice(["table-2", "table-4", "any", "any"])
    if kind != "any":
        return Arm.from_paper(kind), paper_rod(kind)
    L = float(np.exp(rng.uniform(np.log(0.05), np.log(1.0))))
    base = L * rng.uniform(0.02, 0.06)
    tip = base * rng.uniform(0.2, 1.0)
    E, nu = float(np.exp(rng.uniform(np.log(5e4), np.log(2e6)))), float(rng.uniform(0.3, 0.5))
    ends = [L, *np.sort(L * rng.uniform(0.15, 0.9, rng.integers(0, 4)))[::-1].tolist()]
    sections, own = [], []
    for at in ends:
        share = rng.uniform(0.4, 0.95)
        first, last = share * base, share * (base + (tip - base) * at / L)
        angles = tuple(rng.uniform(0, 2 * np.pi, rng.integers(2, 6)).tolist())
        sections.append(Anchorage(at, Linear(first, last), angles))
        own.append(RodSection(at, linear(first, last, at), angles))
    arm = Arm(L, Linear(base, tip), tuple(sections), Material(E, nu, DENSITY))
    return arm, Rod(L, linear(base, tip, L), tuple(own), E, nu)


def _tensions(arm: Arm, rng: np.random.Generator) -> Array:
    """Return tensions (n_tendons,), each of which bends the arm by up to a rad or two."""
    at = np.array([arm.sections[i].at for i, _ in arm.tendons])
    radius = arm.radius.evaluate(at, arm.length)[0]
    unit = arm.material.E * np.pi * radius**3 / 4 / at
    return np.asarray(unit * rng.uniform(0, 1.5, at.size) * (rng.uniform(size=at.size) < 0.5))


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
        arm, rod = _arm(rng)
        kind = rng.choice(["paper", "exact", "exact", "silicone"])
        effects: list[Effect] = [Extension()]
        effects += [ExactTendons()] * (kind != "paper") + [NeoHookean()] * (kind == "silicone")
        heavy = rng.uniform() < 0.3
        if heavy:
            effects += [Weight((0.0, 0.0, -G)), Buoyancy(WATER)]
        T = _tensions(arm, rng)
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
