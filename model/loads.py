"""What a scene's loads are at given arc lengths of an arm: numbers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy

from octoplan.model.arm import Arm
from octoplan.model.effects import (
    Buoyancy,
    Current,
    Extension,
    Friction,
    PointLoad,
    PointMass,
    TipLoad,
    Weight,
)
from octoplan.model.paths import SAME, Array, Path
from octoplan.model.scene import Scene
from octoplan.model.support.checks import LARGEST
from octoplan.model.support.errors import InputError
from octoplan.model.support.units import length_text

# Arc lengths at which the largest radius is sought.
_SAMPLES = 65
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(6)


def is_loaded(scene: Scene) -> bool:
    """Return whether a scene has effects that couple cross-sections, or twist them.

    In all other scenes each cross-section settles by itself.
    """
    return any(effect.couples_sections for effect in scene.effects)


def is_conservative(scene: Scene) -> bool:
    """Return whether all loads of a scene have a potential."""
    tip = scene.find(TipLoad)
    turns = tip is not None and (tip.follower or any(tip.moment))
    return not (turns or scene.has(Current, Friction))


def convergence_order(scene: Scene, order: int, derivatives: bool = False) -> int:
    """Return the order of convergence in a scene; `order` is that of smooth solutions.

    Effects lower the order if their solutions have kinks, at which `derivatives` of the
    equilibrium jump.
    """
    orders = (each.convergence_order(scene, order, derivatives) for each in scene.effects)
    return min(orders, default=order)


def check_loads(arm: Arm, scene: Scene, contact: bool = False) -> None:
    """Raise InputError for loads that this arm cannot have, and for loads that the arm lacks.

    Raise InputError for effects that the calling function does not support; functions that support
    contact with obstacles pass `contact`.
    """
    for effect in scene.effects:
        effect.check_supported(contact)
        effect.check_arm(arm)
    if any(arm.turns) and not is_loaded(scene):
        allowed = "none in a scene without loads; add a load, such as Weight, Friction or Shear"
        raise InputError("Anchorage.turn", "tendons that turn", allowed)
    for load in acting(scene):
        if load.s > arm.length * (1 + 1e-12):
            allowed = f"from 0 to the arm's length, {length_text(arm.length)}"
            raise InputError(f"{load.kind}.s", load.s, allowed)
    friction = scene.find(Friction)
    if friction:
        directions(arm, friction)


def check_responses(scene: Scene) -> None:
    """Raise InputError if the response of an arm to loads is undefined in a scene."""
    for effect in scene.effects:
        effect.check_responses()


class PointForce(NamedTuple):
    """A dead force (3,) [N] in the base frame, at an arc length [m].

    `offset` is that in the local frame (3,) [m], None on the midline; `kind` its effect's name.
    """

    s: float
    force: tuple[float, ...]
    offset: tuple[float, ...] | None
    kind: str


def acting(scene: Scene) -> tuple[PointForce, ...]:
    """Return the scene's point loads, and the weights of its point masses."""
    g = np.array(weight.g) if (weight := scene.find(Weight)) else np.zeros(3)
    return tuple(
        PointForce(each.s, each.force, None, "PointLoad")
        if isinstance(each, PointLoad)
        else PointForce(each.s, tuple((each.mass * g).tolist()), each.offset, "PointMass")
        for each in scene.effects
        if isinstance(each, PointLoad | PointMass)
    )


def levers(scene: Scene) -> tuple[Array, Array]:
    """Return the forces that act off the midline: arc lengths (n,), offsets and forces (n, 6)."""
    rows = [(load.s, *load.offset, *load.force) for load in acting(scene) if load.offset]
    numbers = np.array(rows).reshape(-1, 7)
    return numbers[:, 0], numbers[:, 1:]


def directions(arm: Arm, friction: Friction) -> tuple[int, ...]:
    """Return the way each tendon slides, 1 in and -1 out; InputError for a wrong number of them."""
    if isinstance(friction.direction, int):
        return (friction.direction,) * arm.n_tendons
    if len(friction.direction) != arm.n_tendons:
        allowed = f"one number, or one for each of {arm.n_tendons} tendons"
        raise InputError("Friction.direction", friction.direction, allowed)
    return friction.direction


def places(arm: Arm, scene: Scene) -> tuple[float, ...]:
    """Return the arc lengths inside of the arm that loads want as nodes of the mesh [m].

    Where a point load acts; and where a tendon with friction crosses the midline, as it turns the
    other way from there on and its tension has a kink.
    """
    acts = [load.s for load in acting(scene) if 0 < load.s < arm.length]
    return (*acts, *(_crossings(arm) if scene.has(Friction) else ()))


def growth(arm: Arm, scene: Scene, s: Array) -> Array:
    """Return a bound of the rate at which solutions grow or decay at s (N,), per length [1/m].

    The rate is (F / EJ)^(1/2) under a force F.
    """
    R = arm.radius.evaluate(s, arm.length)[0]
    force = force_bound(arm, scene, s)
    EA = arm.material.E * np.pi * R**2
    longer = 1 + force / EA * scene.has(Extension)
    return np.asarray(np.minimum(longer * np.sqrt(force / (EA * R**2 / 4)), LARGEST))


def force_bound(arm: Arm, scene: Scene, s: Array) -> Array:
    """Return a bound of the resultant force (N,) of all loads beyond arc lengths s (N,) [N]."""
    tip = scene.find(TipLoad)
    force = _capped_norm(specific_weight(arm, scene)) * volume(arm, s)
    force += _capped_norm(tip.force) if tip else 0.0
    for load in acting(scene):
        force += _capped_norm(load.force) * (s <= load.s)
    # Rounding may put the last arc length beyond the tip.
    force += _drag_bound(arm, scene) * np.maximum(arm.length - s, 0.0)
    return np.asarray(force)


def turning_bounds(arm: Arm, scene: Scene) -> tuple[Array, Array]:
    """Return bounds of the moments that loads exert per squared rotation of a cross-section.

    Arc lengths (n,) [m] and moments (n,) [N m], beside those of dead forces on the midline: of
    moments, of forces off the midline, and of loads that change with the shape. Theta, the rotation
    bound of a cross-section, does not decrease from base to tip, so that a follower and a current
    are bounded by their lever arms to the base.
    """
    rows = [
        (load.s, float(np.linalg.norm(load.offset)) * _capped_norm(load.force))
        for load in acting(scene)
        if load.offset
    ]
    tip = scene.find(TipLoad)
    if tip:
        moment = (1.5 if tip.follower else 0.5) * _capped_norm(tip.moment)
        moment += _capped_norm(tip.force) * arm.length * tip.follower
        rows.append((arm.length, moment))
    rows.append((arm.length, _drag_bound(arm, scene) * arm.length**2))
    table = np.array(rows).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def _drag_bound(arm: Arm, scene: Scene) -> float:
    """Return a bound of a current's load per length [N/m]."""
    current = scene.find(Current)
    if current is None:
        return 0.0
    R = arm.radius.evaluate(np.linspace(0.0, arm.length, _SAMPLES), arm.length)[0]
    drag = min(current.density * current.coefficient * R.max(), LARGEST)
    return float(drag * _capped_norm(current.velocity) ** 2)


def beyond(arm: Arm, scene: Scene, s: Array, end: Array) -> Array:
    """Return the resultant (3, N) of all dead forces beyond arc lengths s (N,) [N], base frame.

    Of point loads and masses those at `end` (N,) or farther: the far nodes of the elements that s
    lie in.
    """
    tip = scene.find(TipLoad)
    heavy, force = specific_weight(arm, scene), np.zeros((3, s.size))
    if heavy.any():
        force += np.outer(heavy, volume(arm, s))
    if tip and not tip.follower:
        force += np.array(tip.force)[:, None]
    for load in acting(scene):
        force += np.outer(load.force, load.s >= end - SAME * arm.length)
    return np.asarray(force)


def specific_weight(arm: Arm, scene: Scene) -> Array:
    """Return the weight of a volume of the body, less that of the fluid displaced [N/m3]."""
    weight, fluid = scene.find(Weight), scene.find(Buoyancy)
    if weight is None:
        return np.zeros(3)
    return (arm.material.density - (fluid.density if fluid else 0.0)) * np.array(weight.g)


def volume(arm: Arm, s: Array) -> Array:
    """Return the volume of the body between arc lengths s (N,) and the tip [m3].

    By Gauss quadrature between the arc lengths and the radius path's knots, which is exact for
    radii that are polynomials up to the fifth degree in between.
    """
    ends = np.unique(np.concatenate([[0.0, arm.length], s, arm.radius.knots()]))
    ends = ends[(ends >= 0) & (ends <= arm.length)]
    h = np.diff(ends)
    nodes = (ends[:-1] + h / 2)[:, None] + h[:, None] / 2 * _GAUSS
    area = np.pi * arm.radius.evaluate(nodes.ravel(), arm.length)[0].reshape(nodes.shape) ** 2
    parts = h / 2 * (area @ _WEIGHTS)
    rest = np.concatenate([np.cumsum(parts[::-1])[::-1], [0.0]])
    return np.asarray(rest[np.searchsorted(ends, np.clip(s, 0.0, arm.length))])


def _crossings(arm: Arm) -> list[float]:
    """Return the arc lengths where tendons cross the midline [m]."""
    results: list[float] = []
    for section, path in arm.offset_paths:
        end = arm.sections[section].at

        def y(s: Any, path: Path = path, end: float = end) -> Array:
            return path.evaluate(np.atleast_1d(s), end)[0]

        s = np.linspace(0.0, end, 401)
        at, tiny = y(s), np.finfo(float).tiny
        for i in np.flatnonzero(at[:-1] * at[1:] < 0):
            results.append(scipy.optimize.brentq(lambda s, y=y: y(s)[0], s[i], s[i + 1], xtol=tiny))
        results += s[1:-1][at[1:-1] == 0].tolist() if at.any() else []
    return sorted(results)


def _capped_norm(vector: Any) -> float:
    """Return the size of a vector, capped where its square would overflow."""
    return float(np.linalg.norm(np.clip(vector, -LARGEST, LARGEST)))
