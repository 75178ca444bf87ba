"""Random tensions for which an arm has an equilibrium, and targets from these equilibria."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice, pairwise

import numpy as np

from octoplan.model import Arm, OctoplanError, Scene, Shape, SnapError, settle
from octoplan.model.arm import conical
from octoplan.model.effects import Buoyancy, Extension, Weight
from octoplan.model.paths import Array
from octoplan.model.support.errors import CollapsedError, ConvergenceError
from octoplan.planner.targets import (
    Backbone,
    Bend,
    BendingPlane,
    Fetch,
    Target,
    TipPose,
    TipPosition,
)
from octoplan.planner.targets.fetch import stretches

# Largest tension of a tendon in plans [N].
MAXIMUM = 20.0
# Scenes of the random targets.
SCENES = {
    "paper": Scene(Extension()),
    "silicone": Scene.silicone(),
    "silicone-in-water": Scene.silicone(Weight(), Buoyancy()),
}
# Total pull of all tendons at their largest tension, as a share of the pull that crushes the arm.
_SHARE = 0.8


def most(arm: Arm) -> Array:
    """Return the largest tension of each tendon [N], for equal axial strains in all sections.

    The total pull grows from the tip to the base, as the cross-section does.
    """
    at = np.array([section.at for section in arm.sections])
    EA = arm.material.E * np.pi * arm.radius.evaluate(at, arm.length)[0] ** 2
    count = np.array([len(section.angles) for section in arm.sections])
    return np.repeat(_SHARE * np.diff(EA, prepend=0.0) / count, count)


def tensions(arm: Arm, rng: np.random.Generator, scale: float = 1.0, slack: float = 0.0) -> Array:
    """Return random tensions (n_tendons,) [N] that have an equilibrium.

    The tensions are uniform up to `scale` times the largest. `slack` is the share of tendons with
    zero tension.
    """
    while True:
        T = scale * most(arm) * rng.uniform(size=arm.n_tendons)
        T[rng.uniform(size=T.size) < slack] = 0.0
        try:
            settle(arm, T, Scene(Extension()), 1e-3)
        except CollapsedError:
            continue
        return T


def endless(arm: Arm, rng: np.random.Generator) -> Iterator[Array]:
    """Yield random sets of tensions (n_tendons,) [N] without end."""
    while True:
        yield tensions(arm, rng)


def rows(arm: Arm, rng: np.random.Generator, count: int) -> Array:
    """Return `count` random sets of tensions (count, n_tendons) [N]."""
    return np.array(list(islice(endless(arm, rng), count)))


def many_sections(n: int) -> Arm:
    """Return the body of table 4 with n sections of four tendons at half the radius."""
    L = 0.45
    base = 15e-3
    tip = 2e-3
    ends = [L * (1 - i / n) for i in range(n)]
    offsets = [(base + (tip - base) * at / L) / 2 for at in ends]
    anchorages = [(at, base / 2, offset) for at, offset in zip(ends, offsets, strict=True)]
    return conical(L, (base, tip), anchorages)


def shape(arm: Arm, scene: Scene, rng: np.random.Generator, kind: int) -> Shape:
    """Return an equilibrium of the arm of table 4 or 2 under random tensions.

    In kind 0 each tendon is slack or pulls up to 1, 20, 20 N, tip section first. In kind 1 one
    tendon of each section pulls. In kind 2 all tendons pull, up to 0.5, 4, 13 N. Tensions without
    an equilibrium are replaced by new random ones.
    """
    while True:
        if kind == 0:
            scale = np.array([1.0, 20.0, 20.0])[:, None]
            T = rng.uniform(size=(3, 4)) * scale * (rng.uniform(size=(3, 4)) < 0.5)
        elif kind == 1:
            T = np.zeros((3, 4))
            T[np.arange(3), rng.integers(4, size=3)] = rng.uniform(size=3) * [0.6, 5.0, 15.0]
        else:
            T = rng.uniform(size=(3, 4)) * np.array([0.5, 4.0, 13.0])[:, None]
        try:
            return settle(arm, T, scene)
        except OctoplanError:
            continue


ARM = Arm.from_paper("table-4")
# Largest tensions for the targets, tip section first [N].
_MOST = np.array([0.6, 5.0, 15.0])


def random_tensions(rng: np.random.Generator, kind: str) -> Array:
    """Return random tensions (3, 4) [N] for a kind of target.

    For a plane two neighbouring tendons of one section pull; for other kinds some or all tendons.
    """
    T = rng.uniform(size=(3, 4)) * _MOST[:, None]
    if kind == "plane":
        section = rng.integers(3)
        T[np.arange(3) != section] = 0.0
        first = rng.integers(4)
        T[:, [first, (first + 1) % 4]] = 0.0
        return T * rng.uniform()
    selection = rng.integers(3)
    if selection == 0:
        T *= rng.uniform(size=(3, 4)) < 0.5
    elif selection == 1:
        T *= np.arange(4) == rng.integers(4, size=3)[:, None]
    return T * rng.uniform(0.3, 1.0)


def target(rng: np.random.Generator, kind: str, scene: Scene) -> tuple[Array, Target]:
    """Return random tensions with an equilibrium, and the target that this equilibrium meets."""
    while True:
        T = random_tensions(rng, kind)
        try:
            result = TARGET_OF[kind](settle(ARM, T, scene, 1e-10), T)
        except (CollapsedError, SnapError, ConvergenceError):
            continue
        if result is not None:
            return T, result


def _components(frame: Array, v: Array) -> tuple[float, float, float]:
    """Return the components of v along t, b and -n of a frame, the axes of bends and planes."""
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
TARGET_OF: dict[str, Callable[[Shape, Array], Target | None]] = {
    "tip": lambda shape, _: TipPosition(tuple(shape.tip.tolist())),
    "pose": lambda shape, _: TipPose(tuple(shape.tip.tolist()), _frame(shape)),
    "plane": _plane,
    "fetch": _fetch,
    "backbone": lambda shape, _: Backbone(
        tuple(tuple(shape.position(s).tolist()) for s in _PLACES), _PLACES
    ),
}


def target_error(shape: Shape, target: Target) -> float:
    """Return the distance of a shape from a target: lengths relative to L, angles in rad."""
    if isinstance(target, TipPosition):
        return _distance(shape.tip, target.position)
    if isinstance(target, TipPose):
        turned = float(np.abs(shape.tip_frame - np.array(target.frame)).max())
        return max(_distance(shape.tip, target.position), turned)
    if isinstance(target, BendingPlane):
        _, b, n = _components(np.array(ARM.base_frame), shape.tip - np.array(ARM.base_position))
        out_of_plane = abs(np.cos(target.angle) * n - np.sin(target.angle) * b) / ARM.length
        return max(float(out_of_plane), abs(_bend_in(shape, target.angle) - target.bend))
    if isinstance(target, Fetch):
        wanted = (target.proximal, target.medial, target.distal)
        return max(
            _bend_error(shape, start, end, bend)
            for (start, end), bend in zip(pairwise(stretches(ARM)), wanted, strict=True)
        )
    assert isinstance(target, Backbone) and target.s is not None
    places = zip(target.s, target.points, strict=True)
    return max(_distance(shape.position(s), point) for s, point in places)


def _distance(a: Array, b: object) -> float:
    return float(np.linalg.norm(a - np.array(b))) / ARM.length


def _bend_error(shape: Shape, start: float, end: float, bend: Bend) -> float:
    values = np.array(_components(shape.frame(start), shape.frame(end)[:, 0]))
    across = np.sin(bend.angle)
    wanted = [np.cos(bend.angle), across * np.cos(bend.plane), across * np.sin(bend.plane)]
    return float(np.linalg.norm(values - np.array(wanted)))
