"""Exact relations: values without tension, other units, rotated and mirrored scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from octoplan.model import Arm, Material, Scene, settle, tip_jacobian
from octoplan.model.arm import conical
from octoplan.model.effects import TipLoad
from octoplan.planner import plan, stiffness
from octoplan.planner.targets import TipPosition
from tests.core.hard_cases.family import Array, Family, RefusedError
from tests.core.hard_cases.pulls import STATICS
from tests.random_arms import log_uniform

BARE = {"bare": Scene(), **STATICS}


def even(rng: np.random.Generator) -> tuple[Arm, str, Array]:
    """Draw an arm with four tendons a section, its statics, and the common tension of each section.

    A third of the members has no tension; the others pull alike on all sides of some sections.
    """
    L, n = rng.uniform(0.2, 0.5), int(rng.integers(1, 4))
    ends = L * (1 - np.arange(n) / n)
    anchorages = [(at, *rng.uniform(1e-3, 4e-3, 2)) for at in ends]
    pull = rng.uniform(0, 0.5, n) * (rng.uniform(size=n) < 0.7) * (rng.uniform() < 2 / 3)
    arm = conical(float(L), (0.015, 0.005), anchorages)
    return arm, str(rng.choice(list(BARE))), pull


def check_even(arm: Arm, statics: str, pull: Array) -> float:
    """Return the largest error of a derivative, or 1e7 times the deviation from a straight arm."""
    scene, T = BARE[statics], np.repeat(pull, 4)
    shape = settle(arm, T, scene, 1e-12)
    s = np.linspace(0, arm.length, 23)
    # The mesh of an unloaded arm adds up to the arm's length except for rounding.
    length = arm.length if not T.any() or statics == "bare" else shape.tip[0]
    apart = np.linalg.norm(shape.tip - [length, 0, 0]) / arm.length
    apart = max(apart, np.abs(shape.strain(s)[:, :3]).max() * arm.length)
    apart = max(apart, np.abs(shape.tip_frame - np.diag([1, -1, -1])).max())
    soft = compliance_error(arm, T, scene) if statics in ("bare", "paper") else 0.0
    return max(1e7 * float(apart), slope_error(arm, T, scene), soft)


def slope_error(arm: Arm, T: Array, scene: Scene) -> float:
    """Return the relative error of the tip's Jacobian against one-sided differences."""
    found = tip_jacobian(arm, T, scene, 1e-10)
    wanted, h = np.zeros((3, T.size)), 1e-3
    steps = np.array([0, 1, 2, 3]) * h
    weight = np.array([-11, 18, -9, 2]) / (6 * h)
    for j in range(T.size):
        tips = [settle(arm, T + d * np.eye(T.size)[j], scene, 1e-12).tip for d in steps]
        wanted[:, j] = weight @ np.array(tips)
    gap = np.abs(found[:3] - wanted).max() / np.abs(wanted).max()
    return float(gap) if np.isfinite(found).all() else np.inf


def compliance_error(arm: Arm, T: Array, scene: Scene) -> float:
    """Return the relative error of the lateral compliance against a difference."""
    found = stiffness(arm, T, scene, accuracy=1e-9).compliance
    force = 1e-4 * arm.length / found[1, 1]
    tips = []
    for share in (0.0, 0.5, 1.0):
        load = TipLoad((0.0, share * force, 0.0))
        tips.append(settle(arm, T, Scene(*scene.effects, load), 1e-11).tip)
    wanted = (4 * tips[1] - 3 * tips[0] - tips[2]) / force
    gap = np.abs(found[:3, 1] - wanted).max() / np.abs(wanted).max()
    return float(gap) if np.isfinite(found).all() else np.inf


EXACT_VALUES = Family("exact values", 1e-6, even, check_even)


def in_units(rng: np.random.Generator) -> tuple[float, float, Array, Scene]:
    """Draw factors of lengths and moduli, tensions of the arm of table 4, and a scene.

    Tensions bend the arm by right angles; limits are a few times larger.
    """
    T = np.ravel(rng.uniform(0, 1, (3, 4)) * [[0.2], [1], [3]]) * (rng.uniform(size=12) < 0.5)
    scene = list(STATICS.values())[int(rng.integers(3))]
    modulus = log_uniform(rng, 1e3, 1e9) / Material.E
    return log_uniform(rng, 1e-3, 1e3), modulus, T, scene


def scaled(length: float, modulus: float) -> Arm:
    """Return the arm of table 4 in other units."""
    mm = 1e-3 * length
    rows = [(450, 7.5, 1.0), (315, 3.5, 3.5), (135, 6.0, 6.0)]
    anchorages = [(at * mm, a * mm, b * mm) for at, a, b in rows]
    return conical(450 * mm, (15 * mm, 2 * mm), anchorages, material=Material(Material.E * modulus))


def check_units(length: float, modulus: float, T: Array, scene: Scene) -> float:
    """Return the distance of settled shapes over L, and of planned tensions over the largest."""
    force = modulus * length**2
    arms = scaled(1.0, 1.0), scaled(length, modulus)
    first = settle(arms[0], T, scene, 1e-10)
    second = settle(arms[1], T * force, scene, 1e-10)
    L = arms[0].length
    apart = float(np.linalg.norm(second.tip / length - first.tip)) / L
    targets = TipPosition(tuple(first.tip)), TipPosition(tuple(first.tip * length))
    most = 20.0
    plans = [plan(arms[0], targets[0], scene, most), plan(arms[1], targets[1], scene, most * force)]
    for one in plans:
        if not one.certificate.passed:
            raise RefusedError(one.outcome)
    own, other = (np.ravel(one.tensions) for one in plans)
    return max(apart, float(np.abs(other / force - own).max() / own.max()))


UNITS = Family("units", 1e-10, in_units, check_units)


# Across the plane of t and n, which lies in x and y, T_i2 and T_i4 change places.
MIRROR, PLACES = np.diag([1.0, 1.0, -1.0]), [0, 3, 2, 1]


def turned_scene(rng: np.random.Generator) -> tuple[Array, Scene, Array, Array]:
    """Draw tensions (3, 4) of the arm of table 4, a scene, a rotation, a force at the tip.

    Half of the members are loaded, in the paper's scene.
    """
    T = rng.uniform(0, 1, (3, 4)) * [[0.2], [1], [3]] * (rng.uniform(size=(3, 4)) < 0.5)
    loaded = rng.integers(2)
    scene = list(STATICS.values())[0 if loaded else int(rng.integers(3))]
    turn = Rotation.random(random_state=rng).as_matrix()
    return T, scene, turn, loaded * rng.normal(size=3) * 1e-3


def check_turned(T: Array, scene: Scene, turn: Array, force: Array) -> float:
    """Return the distance of settled shapes over L, and of planned tensions over the largest one.

    Tensions are divided by a hundred: plans have fewer digits than settled shapes.
    """
    arm = Arm.from_paper("table-4")
    frame = turn @ np.array(arm.base_frame)
    turned = replace(arm, base_frame=tuple(map(tuple, frame.tolist())))
    tip = settle(arm, T, loaded(scene, force), 1e-11).tip
    rotated = settle(turned, T, loaded(scene, turn @ force), 1e-11).tip
    mirrored = settle(arm, T[:, PLACES], loaded(scene, MIRROR @ force), 1e-11).tip
    apart = [turn @ tip - rotated, MIRROR @ tip - mirrored]
    error = float(np.linalg.norm(apart, axis=1).max()) / arm.length
    if force.any():
        return error
    ways = [(arm, tip), (turned, turn @ tip), (arm, MIRROR @ tip)]
    plans = [planned(way, scene) for way in ways]
    most = plans[0].max()
    gaps = [plans[1] - plans[0], plans[2][:, PLACES] - plans[0]]
    return max(error, *(float(np.abs(gap).max() / most) / 100 for gap in gaps))


def loaded(scene: Scene, force: Array) -> Scene:
    """Return the scene with a force at the tip if there is one."""
    loads = (TipLoad(tuple(force.tolist())),) if force.any() else ()
    return Scene(*scene.effects, *loads)


def planned(way: tuple[Arm, Array], scene: Scene) -> Array:
    """Return the tensions (3, 4) of a plan."""
    arm, tip = way
    found = plan(arm, TipPosition(tuple(tip)), scene, 20.0)
    if not found.certificate.passed:
        raise RefusedError(found.outcome)
    return np.reshape(found.tensions, (3, 4))


TURNED = Family("rotated, mirrored", 1e-10, turned_scene, check_turned)
