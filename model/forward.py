"""The forward maps, tensions to poses, by name: which scheme carries a scene, built once each."""

from __future__ import annotations

from functools import lru_cache
from typing import Protocol

import casadi as ca

from model.arm import Arm
from model.closed_form import ClosedForm
from model.effects import PrintedStatics
from model.errors import InputError
from model.mesh import Mesh, graded
from model.paths import Array
from model.runge_kutta import RK4, RK6
from model.scene import Scene
from model.stations import Counts
from model.strain_ode import StrainOde

SCHEMES = {"magnus6": None, "rk6": RK6, "rk4": RK4}


class ForwardMap(Protocol):
    """Tensions to poses on one mesh; see ClosedForm and StrainOde."""

    mesh: Mesh
    order: int
    function: ca.Function
    stretch_at: Array
    stretch_active: Counts

    def run(self, tensions: Array) -> Array:
        """Return the node states (S + 1, 7 or more), poses first, base to tip."""

    def dense(self, tensions: Array, states: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains (N, 4), tau, xi, k, q, at arc lengths s (N,)."""


def schemes_of(scene: Scene) -> tuple[str, ...]:
    """Return the names of the schemes that can carry a scene, the fastest first."""
    return ("rk6", "rk4") if scene.has(PrintedStatics) else ("magnus6", "rk6", "rk4")


def check_scheme(scene: Scene, scheme: str | None) -> str:
    """Return the scheme by name, the scene's fastest for None; InputError if it cannot carry it."""
    allowed = schemes_of(scene)
    if scheme is not None and scheme not in allowed:
        raise InputError("scheme", scheme, ", ".join(allowed) + " in this scene")
    return scheme or allowed[0]


@lru_cache(maxsize=256)
def forward_map(
    arm: Arm, scene: Scene, scheme: str, refinement: int, at: tuple[float, ...] = ()
) -> ForwardMap:
    """Return the forward map on a mesh of a refinement that has the arc lengths `at` as nodes."""
    mesh = graded(arm, refinement, at)
    tableau = SCHEMES[scheme]
    return ClosedForm(arm, scene, mesh) if tableau is None else StrainOde(arm, scene, mesh, tableau)
