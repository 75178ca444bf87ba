"""What a scene's loads are at given arc lengths of an arm: numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from model.arm import Arm
from model.effects import Buoyancy, Current, Extension, Friction, PointLoad, TipLoad, Weight
from model.errors import InputError
from model.paths import Array
from model.scene import Scene
from model.stations import Stations, crossing

# Growth, as an exponent, that one segment may have; and the most segments that loads call for.
_GROWTH, _MOST_PIECES, _STEEPEST = 3.0, 60, 1e80
# Of a step of 1/400 of a tendon's length: its crossing is found to rounding.
_HALVINGS = 50
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(6)


@dataclass(frozen=True)
class LoadForm:
    """Which kinds of load there are: what the equations depend on besides numbers.

    Attributes
    ----------
    force : bool
        Whether any load pulls on the arm.
    weight : bool
        Whether a dead load is spread along it.
    velocity : (3,) or None
        Of a current [m/s].
    follower : bool
        Whether the load at the tip turns with it.
    friction : tuple of int or None
        The way each tendon slides: 1 in, -1 out.
    n_sections, n_tendons : int
        Of the arm.
    probed : bool
        Whether a further small force and moment act somewhere: what stiffness asks for.
    lengths : bool
        Whether the lengths of the tendons are states.
    """

    force: bool
    weight: bool
    velocity: tuple[float, ...] | None
    follower: bool
    friction: tuple[int, ...] | None
    n_sections: int
    n_tendons: int
    probed: bool = False
    lengths: bool = False

    @property
    def moving(self) -> bool:
        """Whether some of the force depends on the shape, so that it is a state."""
        return self.follower or self.velocity is not None

    @property
    def rows(self) -> dict[str, int]:
        """The numbers that a cross-section has, by name, and how many of each."""
        tendons = self.n_tendons * (self.friction is not None or self.lengths)
        wanted = {
            "force": 3 * self.force,
            "density": 3 * self.weight,
            "drag": int(self.velocity is not None),
            "paths": 3 * self.n_sections * (tendons > 0),
            "crosses": tendons,
            "mu": int(self.friction is not None),
        }
        return {name: size for name, size in wanted.items() if size}


def load_form(arm: Arm, scene: Scene, probed: bool = False, lengths: bool = False) -> LoadForm:
    """Return the kinds of load in a scene, and what else is wanted of it."""
    tip, current, friction = scene.find(TipLoad), scene.find(Current), scene.find(Friction)
    return LoadForm(
        probed or any(scene.has(kind) for kind in (TipLoad, PointLoad, Weight, Current)),
        scene.has(Weight),
        current.velocity if current else None,
        tip is not None and tip.follower,
        _directions(arm, friction) if friction else None,
        len(arm.sections),
        arm.n_tendons,
        probed,
        lengths,
    )


@lru_cache(maxsize=256)
def check_loads(arm: Arm, scene: Scene) -> None:
    """Raise InputError for loads that this arm cannot have."""
    for load in point_loads(scene):
        if load.s > arm.length * (1 + 1e-12):
            raise InputError("PointLoad.s", load.s, f"from 0 to the arm's length, {arm.length:g} m")
    friction = scene.find(Friction)
    if friction:
        _directions(arm, friction)


def point_loads(scene: Scene) -> list[PointLoad]:
    """Return the scene's point loads."""
    return [effect for effect in scene.effects if isinstance(effect, PointLoad)]


def places(arm: Arm, scene: Scene) -> tuple[float, ...]:
    """Return the arc lengths inside of the arm at which loads call for a segment to begin [m].

    Where a point load acts; where a tendon with friction crosses the midline, as it turns the other
    way from there on and its tension has a kink; and, as solutions of the bent arm under a force F
    grow and decay like the exponential of the integral of (F / EJ)^(1/2), wherever that integral
    has grown by some.
    """
    acts = [load.s for load in point_loads(scene) if 0 < load.s < arm.length]
    if scene.has(Friction):
        acts += _crossings(arm, [*acts, *(section.at for section in arm.sections)])
    s = np.linspace(0.0, arm.length, 1001)
    R, force = arm.radius.evaluate(s, arm.length)[0], _heaviest(arm, scene, s)
    EA = arm.material.E * np.pi * R**2
    longer = 1 + force / EA * scene.has(Extension)
    rate = np.minimum(longer * np.sqrt(force / (EA * R**2 / 4)), _STEEPEST)
    growth = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(s))])
    pieces = int(min(np.ceil(growth[-1] / _GROWTH), _MOST_PIECES))
    cuts = np.interp(np.arange(1, pieces) / max(pieces, 1) * growth[-1], growth, s)
    near = 1e-3 * arm.length
    taken = [*acts, *(section.at for section in arm.sections), 0.0, arm.length]
    free = [float(cut) for cut in cuts if min(abs(cut - other) for other in taken) > near]
    return tuple(acts + free)


def _crossings(arm: Arm, others: list[float]) -> list[float]:
    """Return the arc lengths where tendons cross the midline, found by bisection [m].

    Each once, and none at the places of others.
    """
    found: list[float] = []
    for section in arm.sections:
        s = np.linspace(0.0, section.at, 401)
        y = section.offset.evaluate(s, section.at)[0]
        for i in np.flatnonzero(y[:-1] * y[1:] < 0):
            low, high = float(s[i]), float(s[i + 1])
            for _ in range(_HALVINGS):
                middle = (low + high) / 2
                same = section.offset.evaluate(np.array([middle]), section.at)[0][0] * y[i] > 0
                low, high = (middle, high) if same else (low, middle)
            found.append((low + high) / 2)
        found += s[1:-1][y[1:-1] == 0].tolist() if y.any() else []
    kept: list[float] = []
    for place in sorted(found):
        if all(abs(place - other) > 1e-9 * arm.length for other in [*others, *kept]):
            kept.append(place)
    return kept


def _heaviest(arm: Arm, scene: Scene, s: Array) -> Array:
    """Return a bound of the force beyond s (N,) [N]; capped for loads out of this world."""
    tip, current = scene.find(TipLoad), scene.find(Current)
    force = _size(_heaviness(arm, scene)) * volume(arm, s)
    force += _size(tip.force) if tip else 0.0
    for load in point_loads(scene):
        force += _size(load.force) * (s <= load.s)
    if current:
        R = arm.radius.evaluate(s, arm.length)[0].max()
        drag = min(current.density * current.coefficient * R, _STEEPEST)
        force += drag * _size(current.velocity) ** 2 * (arm.length - s)
    return np.asarray(force)


def _size(vector: Any) -> float:
    return float(np.linalg.norm(np.clip(vector, -_STEEPEST, _STEEPEST)))


def load_numbers(
    arm: Arm, scene: Scene, form: LoadForm, at: Stations, beyond: float
) -> dict[str, Array]:
    """Return the numbers (rows, N) of LoadForm.rows at stations, as if all loads were in full.

    `beyond`: point loads from this arc length on pull on what is there [m].
    """
    current, friction = scene.find(Current), scene.find(Friction)
    numbers: dict[str, Array] = {}
    if form.force:
        tip = scene.find(TipLoad)
        force = np.array(tip.force) if tip and not tip.follower else np.zeros(3)
        for load in point_loads(scene):
            force = force + np.array(load.force) * (load.s >= beyond - 1e-9 * arm.length)
        numbers["force"] = force[:, None] + np.outer(_heaviness(arm, scene), volume(arm, at.s))
    if form.weight:
        area = np.pi * arm.radius.evaluate(at.s, arm.length)[0] ** 2
        numbers["density"] = np.outer(_heaviness(arm, scene), area)
    if current:
        R = arm.radius.evaluate(at.s, arm.length)[0]
        numbers["drag"] = (current.density * current.coefficient * R)[None, :]
    if friction or form.lengths:
        numbers["paths"] = np.vstack([at.y, at.y_rate, at.y_curve])
        numbers["crosses"] = crossing(arm, at).T
    if friction:
        numbers["mu"] = np.full((1, at.s.size), friction.mu)
    return numbers


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
    beyond = np.concatenate([np.cumsum(parts[::-1])[::-1], [0.0]])
    return np.asarray(beyond[np.searchsorted(ends, np.clip(s, 0.0, arm.length))])


def _heaviness(arm: Arm, scene: Scene) -> Array:
    """Return the weight of a volume of the body, less that of the fluid displaced [N/m3]."""
    weight, fluid = scene.find(Weight), scene.find(Buoyancy)
    if weight is None:
        return np.zeros(3)
    return (arm.material.density - (fluid.density if fluid else 0.0)) * np.array(weight.g)


def _directions(arm: Arm, friction: Friction) -> tuple[int, ...]:
    if isinstance(friction.direction, int):
        return (friction.direction,) * arm.n_tendons
    if len(friction.direction) != arm.n_tendons:
        allowed = f"one number, or one for each of {arm.n_tendons} tendons"
        raise InputError("Friction.direction", friction.direction, allowed)
    return friction.direction
