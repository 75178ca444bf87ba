"""Random arms under known loads, with measurements of shapes that another method computes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from octoplan.model import Arm, Scene
from octoplan.model.effects import Extension, Weight
from tests.core.effects.spatial import EnergyRod, LoadedRod, Loads
from tests.oracles import Array, Rod
from tests.random_arms import DENSITY, random_arm, random_pulls

KINDS = ("tip", "pose", "points", "inner")
# A fiftieth of gravity: soft random arms bear their weight.
GRAVITY = 0.02 * np.array([0.0, 0.0, -9.81])


def bending_units(rod: Rod, at: float) -> tuple[float, float]:
    """Return the force at / int (at - s)^2 / EJ ds and the moment 1 / int 1 / EJ ds."""
    s = np.linspace(0, at, 2001)
    EJ = rod.E * np.pi * np.asarray(rod.radius(s)) ** 4 / 4
    force = at / np.trapezoid((at - s) ** 2 / EJ, s)
    return float(force), float(1 / np.trapezoid(1 / EJ, s))


@dataclass(frozen=True, eq=False)
class Draw:
    """Arguments of estimate_load, and the true load.

    Attributes
    ----------
    arm : Arm
    scene : Scene
    tensions : (n_tendons,)
        Measured tensions [N].
    wrench : (6,)
        True force [N] and moment [N m].
    units : (6,)
        Loads that bend the arm by its length or by 1 rad.
    measured : dict
        Further arguments.
    """

    arm: Arm
    scene: Scene
    tensions: Array
    wrench: Array
    units: Array
    measured: dict[str, Any]


def draw(
    seed: int,
    kind: str,
    *,
    rubber: bool = False,
    size: float = 1.0,
    std: float = 1e-3,
    noisy: bool = True,
    tension_std: float = 0.0,
) -> Draw:
    """Return a draw with measurements of one of KINDS.

    With "inner", a force acts at a place inside the arm; otherwise force and moment act on the tip,
    with "tip" a force alone.

    Parameters
    ----------
    size : float
        Largest load, in units.
    std : float
        Standard deviation of positions over the arm's length; that of frames is ten times as large
        [rad].
    noisy : bool
        Whether the measurements have noise.
    tension_std : float
        Standard deviation of tensions over the largest tension.
    """
    rng = np.random.default_rng(seed)
    arm, rod = random_arm(rng, 0.6, 3, 4)
    T = random_pulls(arm, rng, 1.0)
    L = arm.length
    at = float(rng.uniform(0.5, 0.9)) * L if kind == "inner" else L
    units = np.repeat(bending_units(rod, at), 3)
    direction = rng.normal(size=6)
    wrench = units * size * rng.uniform() * direction / np.linalg.norm(direction)
    if kind in ("tip", "inner"):
        wrench[3:] = 0.0
    heavy = bool(rng.integers(2)) or rubber
    loads = Loads(
        force=np.zeros(3) if kind == "inner" else wrench[:3],
        moment=wrench[3:],
        points=((at, wrench[:3]),) if kind == "inner" else (),
        specific_weight=DENSITY * GRAVITY * heavy,
    )
    weight = (Weight(tuple(GRAVITY.tolist())),) if heavy else ()
    scene = Scene.silicone(*weight) if rubber else Scene(Extension(), *weight)
    tension_noise = tension_std * T.max()
    true = np.where(T > 0, np.maximum(T + tension_noise * rng.normal(size=T.size), 0), 0)
    body = EnergyRod(rod, true, loads, rubber=True) if rubber else LoadedRod(rod, true, loads)
    measured: dict[str, Any] = {"std": std * L, "tension_std": tension_noise}
    error = noisy * std * L
    if kind in ("tip", "pose"):
        u, R = body.poses((L,))
        tip = u[0] + error * rng.normal(size=3)
        turned = Rotation.from_rotvec(noisy * 10 * std * rng.normal(size=3)).as_matrix() @ R[0]
        pose = {"pose": (tip, turned), "angle_std": 10 * std}
        measured |= {"tip": tip} if kind == "tip" else pose
    else:
        s = tuple(np.sort(rng.uniform(0.2, 1.0, 5)) * L)
        offsets = rng.normal(size=(5, 3)) * [0, 0.02 * L, 0.02 * L]
        u, R = body.poses(s)
        places = u + np.einsum("nij,nj->ni", R, offsets) + error * rng.normal(size=u.shape)
        measured["points"] = [*zip(s, offsets, places, strict=True)]
        measured["at"] = at
        measured["moment"] = kind == "points"
    return Draw(arm, scene, T, wrench, units, measured)
