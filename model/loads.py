"""What a scene's loads are at given arc lengths of an arm: numbers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import scipy

from octoplan.model.arm import Arm
from octoplan.model.effects import (
    Buoyancy,
    Contact,
    Current,
    Extension,
    Friction,
    PointLoad,
    PointMass,
    PrintedStatics,
    SelfContact,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.extensions.obstacles import numbers_of
from octoplan.model.paths import SAME, Array, Path
from octoplan.model.scene import Scene
from octoplan.model.support.checks import LARGEST
from octoplan.model.support.errors import InputError
from octoplan.model.support.units import length_text

_LOADS = (Contact, Current, Friction, PointLoad, PointMass, Shear, TipLoad, Weight)
_NAMES = tuple(kind.__name__ for kind in _LOADS)
# Those that may bend an arm to the other side than its tendons do.
_BENDING = tuple(kind for kind in _LOADS if kind not in (Friction, Shear))
# Arc lengths at which the largest radius is sought.
_SAMPLES = 65
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(6)


def is_loaded(scene: Scene) -> bool:
    """Return whether a scene has effects that couple cross-sections, or twist them.

    In all other scenes each cross-section settles by itself.
    """
    return scene.has(*_LOADS)


def is_conservative(scene: Scene) -> bool:
    """Return whether all loads of a scene have a potential."""
    tip = scene.find(TipLoad)
    turns = tip is not None and (tip.follower or any(tip.moment))
    return not (turns or scene.has(Current, Friction))


def convergence_order(scene: Scene, order: int, derivatives: bool = False) -> int:
    """Return the order at which errors in a scene fall; `order` is that where all is smooth.

    Tendon friction leaves one less, where a fine mesh is needed to see it; under loads, where an
    arm may bend to both sides, how fast a tendon turns has a kink between. Friction of a part that
    lies on an obstacle acts at nodes. Where a current runs along the arm its load |v_n| v_n has a
    kink in its derivative. `derivatives` of the equilibrium jump at kinks.
    """
    orders = [order - scene.has(Friction)]
    if any(contact.friction for contact in contacts(scene)):
        orders.append(2)
    if scene.has(Friction) and scene.has(*_BENDING):
        orders.append(1 if derivatives else 2)
    if scene.has(Current):
        orders.append(1 if derivatives else 3)
    return min(orders)


def check_loads(arm: Arm, scene: Scene, contact: bool = False) -> None:
    """Raise InputError for loads that this arm cannot have, and an arm that has to have some.

    And for contact, unless what is asked is stated with `contact`.
    """
    if contacts(scene) and not contact:
        allowed = (
            "a scene without contact, which settle, settle_many, stiffness, plan and trajectory "
            "alone take"
        )
        raise InputError("scene", "with contact", allowed)
    if scene.has(SelfContact):
        allowed = (
            "a scene without SelfContact: where parts press on each other is found step by step "
            "from rest, under tensions that are known, by settle alone; a plan or motion with "
            "self_clearance=True keeps the arm clear of itself"
        )
        raise InputError("scene", "with SelfContact", allowed)
    if scene.has(PrintedStatics) and arm.is_curved:
        message = "an arm that is straight at rest: eqs. (10) and (11) are written for that"
        raise InputError("Arm.rest_curvature", arm.rest_curvature, message)
    if any(arm.turns) and not is_loaded(scene):
        allowed = f"none in a scene without loads, or one of {', '.join(sorted(_NAMES))} in it"
        raise InputError("Anchorage.turn", "tendons that turn", allowed)
    for load in acting(scene):
        if load.s > arm.length * (1 + 1e-12):
            allowed = f"from 0 to the arm's length, {length_text(arm.length)}"
            raise InputError(f"{load.kind}.s", load.s, allowed)
    friction = scene.find(Friction)
    if friction:
        directions(arm, friction)


def check_not_printed(scene: Scene) -> None:
    """Raise InputError for equations as printed, which do not tell how an arm answers to loads."""
    if scene.has(PrintedStatics):
        raise InputError("scene", "as printed", "a scene whose equations hold under loads")


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


def contacts(scene: Scene) -> tuple[Contact, ...]:
    """Return the scene's contacts."""
    return tuple(effect for effect in scene.effects if isinstance(effect, Contact))


def bodies_of(scene: Scene) -> Array:
    """Return the numbers (K, 17) of the obstacles that an arm may touch; see Convex.numbers."""
    return numbers_of([contact.obstacle for contact in contacts(scene)])


def without_contacts(scene: Scene) -> Scene:
    """Return a scene in which the arm touches nothing."""
    return Scene(*(effect for effect in scene.effects if not isinstance(effect, Contact)))


def without_friction(scene: Scene) -> Scene:
    """Return a scene whose contacts have no friction."""
    free = [replace(e, friction=0.0) if isinstance(e, Contact) else e for e in scene.effects]
    return Scene(*free)


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
