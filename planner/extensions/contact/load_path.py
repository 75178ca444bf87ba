"""The load path by which an arm came into contact: which of several equilibria it is in.

Friction acts against how far the midline has slipped since the equilibrium before. So along a load
path whose steps have the equilibria x_k under T_k = T_0 + t_k (T - T_0),
r(x_k, T_k, u_{k-1}) = 0, and with D_k = dx_k / dT

    D_k = t_k dx/dT (T_k) - (dr/dx)^-1 dr/du_{k-1} (du/dx D_{k-1}),

from D_0 = 0 on.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy

from octoplan.model.arm import Arm
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.extensions.contact.effects import contacts, without_friction
from octoplan.model.extensions.contact.gaps import along
from octoplan.model.extensions.contact.kernels import BEFORE
from octoplan.model.extensions.contact.path import Path
from octoplan.model.extensions.contact.term import contact_places
from octoplan.model.extensions.contact.touches import ContactFlags
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.errors import InputError
from octoplan.model.support.progress import ProgressLine, report

# Tensions on the path to an equilibrium, in order.
LoadPath = tuple[tuple[float, ...], ...]
# How accurately shapes on the path are settled.
ON_THE_PATH = 1e-4


def rubs(scene: Scene) -> bool:
    """Return whether contacts of a scene have friction."""
    return any(contact.friction for contact in contacts(scene))


def is_same(near: Scene, scene: Scene) -> bool:
    """Return whether scenes are equal; with friction of contacts, up to the friction of `near`."""
    return near == scene or (rubs(scene) and without_friction(near) == without_friction(scene))


def from_rest(arm: Arm, tensions: Array, scene: Scene, name: str = "near") -> LoadPath:
    """Return the load path of an arm that touches nothing under tensions (n_tendons,).

    Friction then depends on no earlier motion. Raises InputError with the name of the argument if
    the arm touches something.
    """
    if settle(arm, tensions, without_friction(scene), ON_THE_PATH).contacts:
        allowed = (
            "the plan that the arm moves from: friction of contacts acts against the motion "
            "before, and an arm that touches something has no history by itself"
        )
        raise InputError(name, None, allowed)
    return (tuple(tensions.tolist()),)


def settled_along(
    arm: Arm,
    load_path: LoadPath,
    tensions: Array,
    scene: Scene,
    accuracy: float,
    machine_code: bool = False,
) -> Shape:
    """Settle an arm under tensions (n_tendons,) at the end of a load path.

    From rest the loads act first; then the tensions change in straight lines along the path.
    `Shape.snaps` reports whether the arm snaps at last. Friction of contacts acts beyond the first
    tensions. Raises the errors of settle.
    """
    if not load_path and not rubs(scene):
        return settle(arm, tensions, scene, accuracy, compile=machine_code)
    rough = min(ON_THE_PATH, accuracy) if rubs(scene) else ON_THE_PATH
    path = load_path or (tuple(np.ravel(tensions).tolist()),)
    near = _at_the_end(arm, path, scene, rough, machine_code)
    return settle(arm, tensions, scene, accuracy, compile=machine_code, near=near)


@lru_cache(maxsize=8)
def _at_the_end(
    arm: Arm, load_path: LoadPath, scene: Scene, accuracy: float, machine_code: bool
) -> Shape:
    """Return the shape at the last tensions of a load path.

    Cached: search and certificate need the same path, of up to a hundred steps.
    """
    first, *others = load_path
    near = settle(arm, first, without_friction(scene), accuracy, compile=machine_code)
    for i, T in enumerate(others):
        report("load path", i, len(others))
        with ProgressLine(False):
            near = settle(arm, T, scene, accuracy, compile=machine_code, near=near)
    return near


def path_sensitivities(path: Path) -> Array:
    """Return dx/dT (n_states, n_tendons) at the end of a load path, by all of it."""
    (before, _), *steps = path
    sensitivity = np.zeros((before.system.layout.n_states, before.system.layout.n_tendons))
    for point, factor in steps:
        by_step = factor * point.by_tensions
        sensitivity = by_step + _by_history(before, sensitivity, point, by_step)
        before = point
    return sensitivity


def _by_history(before: Equilibrium, earlier: Array, point: Equilibrium, by_step: Array) -> Array:
    """Return the part of dx/dT (n_states, n_tendons) that follows from the previous equilibrium.

    `earlier` is dx/dT of the previous equilibrium, `by_step` the part of the tensions alone. A
    contact point that moves along the arm refers to another station of the previous equilibrium, by
    the angle between the tangents of both.
    """
    system, touches = point.system, ContactFlags.of(point.system)
    of, s, n = system.layout, system.mesh.s, system.layout.n_tendons
    k, j = np.nonzero(touches.points)
    # Derivatives of previous node positions by tensions and by shifts of points along the arm.
    were = np.zeros((s.size, 3, n + k.size))
    nodes = before.system.layout.nodes[:, 4:7]
    were[:, :, :n] = scipy.interpolate.make_interp_spline(before.mesh.s, earlier[nodes])(s)
    if k.size:
        now, then = (along(at.system, at.x, s[k], j)[1] for at in (point, before))
        were[k, :, n + np.arange(k.size)] = then - now
    change = np.zeros((of.equations.n_p, n + k.size))
    rows = of.equations.named(change)["touch"]["values"][BEFORE]
    rows = rows.reshape(3, of.elements, len(contacts(system.scene)), n + k.size)
    rows[:] = were[1:, None].transpose(2, 0, 1, 3)
    by = -point.solve(of.equations.along_parameters(point.x, system.p, change))
    by_history, by_shift, shifts = by[:, :n], by[:, n:], contact_places(of).touches[k, j, 1]
    shifted = np.linalg.solve(np.eye(k.size) - by_shift[shifts], (by_step + by_history)[shifts])
    return np.asarray(by_history + by_shift @ shifted)
