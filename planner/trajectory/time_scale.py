"""How slow a motion has to be for the arm to be at rest all along: its slowest natural period."""

from __future__ import annotations

import numpy as np

from model.effects import Buoyancy
from model.loads import contacts
from model.paths import Array
from model.shape import Shape
from model.stiffness import stiffness

_PLACES = 101


def slowest_period(shape: Shape) -> float:
    """Return an estimate of the period of the arm's slowest oscillation about a shape [s].

    2 pi sqrt(c m): c the tip's largest compliance, tensions held; m the mass that moves with the
    tip, of places that move in proportion to their arc length squared, as those of a cantilever
    about do (Rayleigh's method). A fluid that buoys the arm moves along, as much as it displaces.
    """
    arm, s = shape.arm, np.linspace(0.0, shape.arm.length, _PLACES)
    area = np.pi * arm.radius.evaluate(s, arm.length)[0] ** 2
    fluid = shape.scene.find(Buoyancy)
    density = arm.material.density + (fluid.density if fluid else 0.0)
    mass = density * np.trapezoid(area * (s / arm.length) ** 4, s)
    near = shape if contacts(shape.scene) else None
    k = stiffness(arm, shape.tensions, shape.scene, accuracy=1e-3, near=near)
    compliance = float(np.linalg.eigvalsh(k.compliance[:3, :3]).max())
    return float(2 * np.pi * np.sqrt(compliance * mass))


def inertia(times: Array, tips: Array) -> float:
    """Return the largest acceleration of the tip over gravity, where a motion speeds up and slows.

    Of tips (N, 3) [m] at times (N,) [s]: from waypoint to waypoint as if halfway faster and
    halfway slower.
    """
    steps = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    return float((4 * steps / np.diff(times) ** 2).max() / 9.81)
