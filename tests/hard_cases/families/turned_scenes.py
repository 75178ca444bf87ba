"""Rotated and mirrored scenes: the rotated and mirrored settle and plan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from model import Arm, Scene, settle
from model.effects import ExactTendons, Extension, TipLoad
from planner import plan
from planner.targets import TipPosition
from tests.hard_cases.family import Array, Family, RefusedError

SCENES = (
    (Extension(),),
    (Extension(), ExactTendons()),
    Scene.silicone().effects,
)
# Across the plane of t and n, which lies in x and y, T_i2 and T_i4 change places.
MIRROR, PLACES = np.diag([1.0, 1.0, -1.0]), [0, 3, 2, 1]


@dataclass(frozen=True, eq=False)
class Member:
    """Tensions (3, 4) of the arm of table 4, a scene, a rotation, a force at the tip."""

    T: Array
    effects: tuple[object, ...]
    turn: Array
    force: Array


def draw(rng: np.random.Generator) -> Member:
    """Half of the members are loaded, in the paper's scene."""
    T = rng.uniform(0, 1, (3, 4)) * [[0.2], [1], [3]] * (rng.uniform(size=(3, 4)) < 0.5)
    loaded = rng.integers(2)
    effects = SCENES[0 if loaded else int(rng.integers(3))]
    turn = Rotation.random(random_state=rng).as_matrix()
    return Member(T, effects, turn, loaded * rng.normal(size=3) * 1e-3)


def check(member: Member) -> float:
    """Return how far settles over L and planned tensions over the largest are apart."""
    arm, T = Arm.from_paper("table-4"), member.T
    frame = member.turn @ np.array(arm.base_frame)
    turned = replace(arm, base_frame=tuple(map(tuple, frame.tolist())))
    tip = settle(arm, T, scene(member, member.force), 1e-11).tip
    rotated = settle(turned, T, scene(member, member.turn @ member.force), 1e-11).tip
    mirrored = settle(arm, T[:, PLACES], scene(member, MIRROR @ member.force), 1e-11).tip
    apart = [member.turn @ tip - rotated, MIRROR @ tip - mirrored]
    error = float(np.linalg.norm(apart, axis=1).max()) / arm.length
    if member.force.any():
        return error
    ways = [(arm, tip), (turned, member.turn @ tip), (arm, MIRROR @ tip)]
    plans = [planned(way, member) for way in ways]
    most = plans[0].max()
    gaps = [plans[1] - plans[0], plans[2][:, PLACES] - plans[0]]
    return max(error, *(float(np.abs(gap).max() / most) for gap in gaps))


def scene(member: Member, force: Array) -> Scene:
    """Return the member's scene, with a force at the tip if there is one."""
    loads = (TipLoad(tuple(force.tolist())),) if force.any() else ()
    return Scene(*member.effects, *loads)


def planned(way: tuple[Arm, Array], member: Member) -> Array:
    """Return the tensions (3, 4) of a plan."""
    arm, tip = way
    found = plan(arm, TipPosition(tuple(tip)), scene(member, np.zeros(3)), 20.0)
    if not found.certificate.passed:
        raise RefusedError(found.outcome)
    return np.reshape(found.tensions, (3, 4))


FAMILY = Family("rotated, mirrored", 1e-10, draw, check)
