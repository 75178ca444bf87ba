"""Settle many sets of tensions at once: their tips, without the overhead of a call for each."""

from __future__ import annotations

from typing import Any

import numpy as np

from model.arm import Arm
from model.checks import finite_array
from model.errors import InputError
from model.machine.compiled import Compile, checked_compile
from model.many_sets import ManySets
from model.mesh_refinement import checked_accuracy
from model.paths import Array
from model.scene import Scene
from model.settle import ACCURACY, checked_scene, settle
from model.shape import Shape
from model.shapes import Errors, Problems, Shapes


def settle_many(
    arm: Arm,
    tensions: Any = None,
    scene: Scene | None = None,
    accuracy: float = ACCURACY,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    *,
    lengths: Any = None,
    tendon_EA: float | None = None,
    tendon_outside: float = 0.0,
    errors: Errors = "raise",
) -> Shapes:
    """Return the tips for many sets of tensions (m, n_sections, n) or (m, n_tendons) [N].

    As settle, but for rounding: side by side, and only those that a mesh does not settle to the
    accuracy go on to a finer one. With
    `lengths`, of the same form [m], tendons are held by these: one set after the other.

    Parameters
    ----------
    errors : "raise" or "nan"
        Whether a set that is not allowed or does not settle ends all with its error, or is a row of
        nan with the reason in `problems`, as in a sweep, while the others are settled.

    Raises
    ------
    InputError, CollapsedError, ConvergenceError, SnapError
        As settle does, naming the set, unless `errors` is "nan".
    CompilerError
        If `compile` is True, and there is no compiler or it fails.
    """
    scene = checked_scene(arm, scene)
    accuracy = checked_accuracy(accuracy)
    machine_code = checked_compile(compile)
    problems = Problems(errors)
    if lengths is not None:
        winches = {"tendon_EA": tendon_EA, "tendon_outside": tendon_outside}
        held = {"lengths": lengths, "tensions": tensions}
        options = {**winches, "compile": machine_code}
        return _by_lengths(arm, held, scene, accuracy, options, problems)
    T = _stack(arm, tensions, problems)
    return ManySets(arm, T, scene, accuracy, machine_code, problems).shapes()


def _by_lengths(
    arm: Arm,
    held: dict[str, Any],
    scene: Scene,
    accuracy: float,
    options: dict[str, Any],
    problems: Problems,
) -> Shapes:
    """Return the tips by sets of lengths, and of tensions where these are given in part."""
    lengths, tensions = held["lengths"], held["tensions"]
    for name, values in held.items():
        if values is not None and not hasattr(values, "__len__"):
            raise InputError(name, values, f"a set of {name} for each shape to settle")
    if tensions is not None and len(tensions) != len(lengths):
        raise InputError("tensions", f"{len(tensions)} sets", f"{len(lengths)}, as of lengths")
    shapes: list[Shape | None] = [None] * len(lengths)
    for i, row in enumerate(lengths):
        T = None if tensions is None else tensions[i]
        with problems.of(i):
            try:
                shapes[i] = settle(arm, T, scene, accuracy, lengths=row, **options)
            except InputError as reason:
                field = reason.field.replace("lengths", f"lengths[{i}]", 1)
                raise InputError(field, reason.given, reason.allowed) from None
    return _of(arm, shapes, problems)


def _of(arm: Arm, shapes: list[Shape | None], problems: Problems) -> Shapes:
    m, n = len(shapes), arm.n_tendons
    found = Shapes(
        np.zeros((m, 3)),
        np.zeros((m, 3, 3)),
        np.zeros(m),
        np.zeros((m, n)),
        np.zeros((m, n), dtype=bool),
    )
    for i, shape in enumerate(shapes):
        if shape is not None:
            found.tip[i], found.tip_frame[i], found.error[i] = (
                shape.tip,
                shape.tip_frame,
                shape.error,
            )
            found.tensions[i], found.slack[i] = shape.tensions, shape.slack.ravel()
    return problems.kept(found)


def _stack(arm: Arm, tensions: Any, problems: Problems) -> Array:
    if not hasattr(tensions, "__len__"):
        raise InputError("tensions", tensions, "a set of tensions for each shape to settle")
    if isinstance(tensions, np.ndarray) and tensions.dtype == float and len(tensions):
        shapes = ((arm.n_tendons,), arm.by_section(np.zeros(arm.n_tendons)).shape)
        if tensions.shape[1:] in shapes and np.all((tensions >= 0) & (tensions < np.inf)):
            return tensions.reshape(len(tensions), -1)
    rows = list(tensions)
    if not rows:
        return finite_array("tensions", np.zeros((0, arm.n_tendons)), (None, arm.n_tendons))
    stacked = np.zeros((len(rows), arm.n_tendons))
    for i, row in enumerate(rows):
        with problems.of(i):
            stacked[i] = arm.flat(row, f"tensions[{i}]")
    return stacked
