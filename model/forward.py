"""The forward maps, tensions to poses, by name: which scheme carries a scene, built once each."""

from __future__ import annotations

from functools import lru_cache
from typing import Protocol

import casadi as ca

from model.arm import Arm
from model.closed_form import ClosedForm
from model.effects import PrintedStatics
from model.errors import InputError
from model.loaded import Loaded
from model.loads import places
from model.magnus import MAGNUS2, MAGNUS4, MAGNUS6, Magnus
from model.mesh import Mesh, graded
from model.paths import Array
from model.runge_kutta import RK4, RK6, RK8, RungeKutta
from model.scene import Scene
from model.statics import is_loaded
from model.stations import Counts
from model.strain_ode import StrainOde

SCHEMES: dict[str, Magnus | RungeKutta] = {
    scheme.name: scheme for scheme in (MAGNUS6, RK6, RK8, RK4, MAGNUS4, MAGNUS2)
}


class ForwardMap(Protocol):
    """Tensions to poses on one mesh; see ClosedForm, StrainOde and Loaded."""

    mesh: Mesh
    order: int
    stretch_at: Array

    def __hash__(self) -> int:
        """Return the hash of this object, not of its values."""

    def run(self, tensions: Array, near: Array | None = None) -> Array:
        """Return the node states (S + 1, 7 or more), poses first, base to tip.

        `near` are the starts of the same equilibrium on another mesh; only loaded scenes use them.
        """

    def starts(self, states: Array) -> Array | None:
        """Return the states (n_x, segments) at the tip side of each segment, if it shoots.

        They are what `run` on another mesh takes as `near`, and what multiple shooting solves for.
        """

    def stretch(self, tensions: Array, states: Array) -> Array:
        """Return 1 + q (K,) at the arc lengths `stretch_at`."""

    def dense(self, tensions: Array, states: Array, s: Array) -> tuple[Array, Array]:
        """Return poses (N, 7) and strains at arc lengths s (N,).

        Strains (N, 4) are tau, xi, k, q; with nu_n, nu_b (N, 6) where sections may slide.
        """


class ExplicitMap(ForwardMap, Protocol):
    """A forward map without unknowns: `function` takes tensions to poses (7, S + 1) and 1 + q.

    `stretch_active` sections cross at the arc lengths `stretch_at`.
    """

    function: ca.Function
    stretch_active: Counts


def schemes_of(scene: Scene) -> tuple[str, ...]:
    """Return the names of the schemes that can carry a scene.

    First the one that is used unless another is named, then the one that checks it.
    """
    steps_only = scene.has(PrintedStatics) or is_loaded(scene)
    return tuple(
        name for name, scheme in SCHEMES.items() if isinstance(scheme, RungeKutta) or not steps_only
    )


def check_scheme(scene: Scene, scheme: str | None) -> str:
    """Return the scheme by name, the scene's first for None; InputError if it cannot carry it."""
    allowed = schemes_of(scene)
    if scheme is not None and scheme not in allowed:
        raise InputError("scheme", scheme, ", ".join(allowed) + " in this scene")
    return scheme or allowed[0]


def forward_map(
    arm: Arm, scene: Scene, scheme: str, refinement: int, at: tuple[float, ...] = ()
) -> ForwardMap:
    """Return the forward map on a mesh of a refinement that has the arc lengths `at` as nodes."""
    if is_loaded(scene):
        return loaded_map(arm, scene, scheme, refinement, at)
    return explicit_map(arm, scene, scheme, refinement, at)


@lru_cache(maxsize=256)
def loaded_map(
    arm: Arm, scene: Scene, scheme: str, refinement: int, at: tuple[float, ...] = ()
) -> Loaded:
    """Return the forward map of a scene with loads; see forward_map."""
    method = SCHEMES[scheme]
    assert isinstance(method, RungeKutta)
    return Loaded(arm, scene, graded(arm, refinement, (*at, *places(arm, scene))), method)


@lru_cache(maxsize=256)
def explicit_map(
    arm: Arm, scene: Scene, scheme: str, refinement: int, at: tuple[float, ...] = ()
) -> ExplicitMap:
    """Return the forward map of a scene without loads; see forward_map."""
    method = SCHEMES[scheme]
    mesh = graded(arm, refinement, at)
    if isinstance(method, Magnus):
        return ClosedForm(arm, scene, mesh, method)
    return StrainOde(arm, scene, mesh, method)
