"""Arms whose contact has closed forms."""

import numpy as np

from model import Anchorage, Arm, Material
from model.paths import Linear


def bar(length: float, radius: float, E: float, density: float = 1000.0) -> Arm:
    """Return a straight bar with four tendons at half its radius."""
    ends = (Anchorage(length, Linear(radius / 2, radius / 2)),)
    material = Material(E=E, nu=0.5, density=density)
    return Arm(length, Linear(radius, radius), ends, material)


def stiffness(radius: float, E: float) -> float:
    """Return E J [N m2]."""
    return E * np.pi * radius**4 / 4
