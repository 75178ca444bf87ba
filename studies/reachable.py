"""Random targets that are reachable, because they are read off settled shapes, and their check.

What a shape is to its target is worked out here from positions and frames, by NumPy, not from the
planner's residuals.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from model import Arm, CollapsedError, ConvergenceError, Scene, Shape, SnapError, settle
from model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    Friction,
    PointLoad,
    Shear,
    TipLoad,
    Weight,
)
from model.paths import Array
from planner.targets import Backbone, Bend, BendingPlane, Fetch, Target, TipPose, TipPosition
from planner.targets.fetch import stretches

ARM = Arm.from_paper("table-4")
MAXIMUM = 20.0
# How often each scene is drawn: those that take a planner seconds seldom.
SCENES: dict[str, tuple[int, Scene]] = {
    "bare": (20, Scene()),
    "extension": (40, Scene(Extension())),
    "exact": (12, Scene(Extension(), ExactTendons())),
    "silicone": (6, Scene.silicone()),
    "water": (5, Scene(Extension(), Weight(), Buoyancy(1000.0))),
    "payload": (4, Scene(Extension(), TipLoad((0.0, 0.0, -0.002)))),
    "follower": (3, Scene(Extension(), TipLoad((0.0, 0.002, 0.0), follower=True))),
    "point load": (2, Scene(Extension(), PointLoad(0.2, (0.0, 0.0, -0.02)))),
    "current": (1, Scene(Extension(), Current((0.0, 0.05, 0.0)))),
    "shear": (1, Scene(Extension(), Shear())),
    "friction": (1, Scene(Extension(), Friction(0.05))),
}
_MOST = np.array([0.6, 5.0, 15.0])


def tensions(rng: np.random.Generator, kind: str) -> Array:
    """Return tensions (3, 4) [N]: those of a section for a plane, few or all for other kinds."""
    T = rng.uniform(size=(3, 4)) * _MOST[:, None]
    if kind == "plane":
        section = rng.integers(3)
        T[np.arange(3) != section] = 0.0
        first = rng.integers(4)
        T[:, [first, (first + 1) % 4]] = 0.0
        return T * rng.uniform()
    way = rng.integers(3)
    if way == 0:
        T *= rng.uniform(size=(3, 4)) < 0.5
    elif way == 1:
        T *= np.arange(4) == rng.integers(4, size=3)[:, None]
    return T * rng.uniform(0.3, 1.0)


def draw(rng: np.random.Generator, kind: str, scene: Scene) -> tuple[Array, Target]:
    """Return tensions that the arm bears, and the target that they reach."""
    while True:
        T = tensions(rng, kind)
        try:
            target = READ[kind](settle(ARM, T, scene, 1e-10), T)
        except (CollapsedError, SnapError, ConvergenceError):
            continue
        if target is not None:
            return T, target


def _components(frame: Array, v: Array) -> tuple[float, float, float]:
    """Return v along t, b and -n of a frame: the axes that bends and planes are counted from."""
    return float(v @ frame[:, 0]), float(v @ frame[:, 2]), float(-v @ frame[:, 1])


def _plane(shape: Shape, T: Array) -> Target | None:
    base = np.array(ARM.base_frame)
    _, b, n = _components(base, shape.tip - np.array(ARM.base_position))
    angle = float(np.arctan2(n, b))
    bend = _bend_in(shape, angle)
    section = 1 + int(np.argmax(T.sum(axis=1)))
    return BendingPlane(angle, bend, section) if 0.01 < bend < np.pi else None


def _bend_in(shape: Shape, angle: float) -> float:
    t, b, n = _components(np.array(ARM.base_frame), shape.tip_frame[:, 0])
    return float(np.arctan2(np.cos(angle) * b + np.sin(angle) * n, t))


def _fetch(shape: Shape, _: Array) -> Target | None:
    bends = []
    for start, end in pairwise(stretches(ARM)):
        t, b, n = _components(shape.frame(start), shape.frame(end)[:, 0])
        bends.append(Bend(float(np.arccos(np.clip(t, -1, 1))), float(np.arctan2(n, b))))
    return Fetch(*bends) if min(bend.angle for bend in bends) > 0.01 else None


def _frame(shape: Shape) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in shape.tip_frame.tolist())


_PLACES = tuple((ARM.length * np.arange(1, 7) / 6).tolist())
READ: dict[str, Callable[[Shape, Array], Target | None]] = {
    "tip": lambda shape, _: TipPosition(tuple(shape.tip.tolist())),
    "pose": lambda shape, _: TipPose(tuple(shape.tip.tolist()), _frame(shape)),
    "plane": _plane,
    "fetch": _fetch,
    "backbone": lambda shape, _: Backbone(
        tuple(tuple(shape.position(s).tolist()) for s in _PLACES), _PLACES
    ),
}


def off(shape: Shape, target: Target) -> float:
    """Return how far a shape is from a target: lengths over the arm's, angles in rad."""
    if isinstance(target, TipPosition):
        return _apart(shape.tip, target.position)
    if isinstance(target, TipPose):
        turned = float(np.abs(shape.tip_frame - np.array(target.frame)).max())
        return max(_apart(shape.tip, target.position), turned)
    if isinstance(target, BendingPlane):
        _, b, n = _components(np.array(ARM.base_frame), shape.tip - np.array(ARM.base_position))
        leaves = abs(np.cos(target.angle) * n - np.sin(target.angle) * b) / ARM.length
        return max(float(leaves), abs(_bend_in(shape, target.angle) - target.bend))
    if isinstance(target, Fetch):
        wanted = (target.proximal, target.medial, target.distal)
        return max(
            _off_bend(shape, start, end, bend)
            for (start, end), bend in zip(pairwise(stretches(ARM)), wanted, strict=True)
        )
    assert isinstance(target, Backbone) and target.s is not None
    places = zip(target.s, target.points, strict=True)
    return max(_apart(shape.position(s), point) for s, point in places)


def _apart(a: Array, b: object) -> float:
    return float(np.linalg.norm(a - np.array(b))) / ARM.length


def _off_bend(shape: Shape, start: float, end: float, bend: Bend) -> float:
    found = np.array(_components(shape.frame(start), shape.frame(end)[:, 0]))
    across = np.sin(bend.angle)
    wanted = [np.cos(bend.angle), across * np.cos(bend.plane), across * np.sin(bend.plane)]
    return float(np.linalg.norm(found - np.array(wanted)))
