"""Settle an arm: tensions to shape, to the accuracy asked for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.arm import Arm
from model.checks import finite_array, kind, within
from model.compiled import compiled
from model.errors import CollapsedError, InputError, NotSettledError, SnapError
from model.forward import ExplicitMap, ForwardMap, check_scheme, explicit_map, forward_map
from model.loads import check_loads
from model.paths import Array
from model.rotations import matrices
from model.scene import Scene
from model.shape import Shape
from model.statics import is_loaded

ACCURACY = 1e-6
_FINEST = 256
_CAUTION = 4.0
# A mesh up to this one may be too coarse to say that the arm snaps.
_COARSE = 16
_ROUNDING = 1e-14


def settle(
    arm: Arm,
    tensions: Any,
    scene: Scene | None = None,
    accuracy: float = ACCURACY,
    scheme: str | None = None,
) -> Shape:
    """Return the shape that an arm takes under tensions.

    Parameters
    ----------
    tensions : (n_sections, n) or (n_tendons,)
        [N], tip section first.
    scene : Scene
        The effects called for; the bare arm `Scene()` unless given.
    accuracy : float
        Tip error over arm length that is accepted, from 1e-12 to 0.1. The mesh is refined by
        doubling until the difference between two meshes says that the finer one is as good.
    scheme : str
        The integrator; the scene's fastest unless given.

    Raises
    ------
    InputError
        For tensions, accuracies and schemes that are not allowed.
    CollapsedError
        Where 1 + q reaches 0.
    NotSettledError
        If the finest mesh is not as accurate as asked.
    SnapError
        If the arm snaps, folds or buckles before the loads are in full.
    """
    scene = _checked(arm, scene)
    T = arm.flat(tensions)
    scheme = check_scheme(scene, scheme)
    coarse: Array | None = None
    near: Array | None = None
    error = np.inf
    for refinement, forward in _ladder(arm, scene, scheme, accuracy):
        try:
            states = forward.run(T, near)
        except SnapError:
            if refinement >= _COARSE:
                raise
            continue
        near = forward.starts(states)
        if coarse is not None:
            error = _estimate(states[-1, 4:7] - coarse, forward.order, arm.length)
            if error <= accuracy:
                _check_stretch(forward, T, states)
                return Shape(arm, scene, T, float(error), scheme, refinement, states)
        coarse = states[-1, 4:7]
    _check_stretch(forward, T, states)
    raise NotSettledError(accuracy, float(error), "ask for less accuracy or a smoother arm")


@dataclass(frozen=True, eq=False)
class Shapes:
    """The tips of many settled shapes.

    Attributes
    ----------
    tip : (m, 3)
        [m].
    tip_frame : (m, 3, 3)
        Columns t, n, b.
    error : (m,)
        Estimated tip error over arm length [-].
    """

    tip: Array
    tip_frame: Array
    error: Array


def settle_many(
    arm: Arm,
    tensions: Any,
    scene: Scene | None = None,
    accuracy: float = ACCURACY,
    compile: bool = False,  # noqa: A002  (the name that scripts use)
) -> Shapes:
    """Return the tips for many sets of tensions (m, n_sections, n) or (m, n_tendons) [N].

    As settle, without the overhead of a call for each; only those that a mesh does not settle to
    the accuracy go on to the next. With `compile` the C compiler of the machine is used: the same
    digits, sooner for many sets. Raises as settle does, naming the set, and CompilerError.
    """
    scene = _checked(arm, scene)
    T = _stack(arm, tensions)
    scheme = check_scheme(scene, None)
    if is_loaded(scene):
        return _one_by_one(arm, T, scene, accuracy, compile)
    poses, errors = np.zeros((len(T), 7)), np.full(len(T), np.inf)
    coarse = np.full((len(T), 3), np.inf)
    left = np.arange(len(T))
    for refinement, _ in _ladder(arm, scene, scheme, accuracy):
        forward = explicit_map(arm, scene, scheme, refinement)
        tips, stretch = _tips(forward, compile)(T[left].T)[:2]
        poses[left] = np.array(tips).T
        error = _estimate(poses[left, 4:] - coarse[left], forward.order, arm.length)
        coarse[left], errors[left] = poses[left, 4:], error
        settled = error <= accuracy
        for i in left[settled & ~(np.array(stretch)[0] > 0)]:
            _check_stretch(forward, T[i], forward.run(T[i]), f"tensions[{i}]")
        left = left[~settled]
        if left.size == 0:
            return Shapes(poses[:, 4:], matrices(poses[:, :4]), errors)
    raise NotSettledError(
        accuracy, float(errors[left].max()), f"ask for less accuracy, or look at set {left[0]}"
    )


def _one_by_one(arm: Arm, T: Array, scene: Scene, accuracy: float, machine_code: bool) -> Shapes:
    if machine_code:
        raise InputError("compile", True, "False in a scene with loads, whose maps are implicit")
    shapes = [settle(arm, row, scene, accuracy) for row in T]
    return Shapes(
        np.array([shape.tip for shape in shapes]).reshape(-1, 3),
        np.array([shape.tip_frame for shape in shapes]).reshape(-1, 3, 3),
        np.array([shape.error for shape in shapes]),
    )


def _ladder(
    arm: Arm, scene: Scene, scheme: str, accuracy: float
) -> Iterator[tuple[int, ForwardMap]]:
    """Yield meshes of doubled refinement, from where the accuracy is usually met next."""
    within("accuracy", accuracy, 1e-12, 0.1)
    order = forward_map(arm, scene, scheme, 1).order
    guess = np.log2((1e-3 / accuracy) ** (1 / order))
    refinement = 2 ** int(np.clip(np.floor(guess), 0, 5))
    while refinement <= _FINEST:
        yield refinement, forward_map(arm, scene, scheme, refinement)
        refinement *= 2


def _estimate(change: Array, order: int, length: float) -> Any:
    """Return the error of the finer of two meshes, over L, from the change between them."""
    error = _CAUTION * np.linalg.norm(change, axis=-1) / (2**order - 1) / length
    return np.maximum(error, _ROUNDING)


def _check_stretch(forward: ForwardMap, tensions: Array, states: Array, which: str = "") -> None:
    stretch = forward.stretch(tensions, states)
    if np.isnan(stretch).any():
        s = forward.stretch_at[np.argmax(np.isnan(stretch))]
        place = (
            f"{which}{': ' * bool(which)}no equilibrium of the section at s = {s:.6g} m was found"
        )
        raise NotSettledError(0.0, np.inf, f"{place}; lower the tensions that cross it")
    if not stretch.min() > 0:
        worst = int(np.argmin(stretch))
        raise CollapsedError(float(forward.stretch_at[worst]), float(stretch[worst]), which)


@lru_cache(maxsize=64)
def _tips(forward: ExplicitMap, machine_code: bool) -> ca.Function:
    """Return tensions (n_tendons,) -> tip pose (7,), least 1 + q."""
    T = ca.MX.sym("T", forward.function.size1_in(0))
    poses, stretch = forward.function(T)[:2]
    tips = ca.Function("tips", [T], [poses[:, -1], ca.mmin(stretch)])
    return compiled(tips) if machine_code else tips


def _checked(arm: Arm, scene: Scene | None) -> Scene:
    """Return the scene, the bare one for None; refuse what is not an arm or a scene."""
    kind("arm", arm, Arm, "an Arm, such as Arm.from_paper(...)")
    kind("scene", scene if scene is not None else Scene(), Scene, "a Scene, such as Scene()")
    scene = scene if scene is not None else Scene()
    check_loads(arm, scene)
    return scene


def _stack(arm: Arm, tensions: Any) -> Array:
    if not hasattr(tensions, "__len__"):
        raise InputError("tensions", tensions, "a set of tensions for each shape to settle")
    rows = list(tensions)
    if not rows:
        return finite_array("tensions", np.zeros((0, arm.n_tendons)), (None, arm.n_tendons))
    return np.array([arm.flat(row, f"tensions[{i}]") for i, row in enumerate(rows)])
