"""Settle many sets of tensions at once: their tips, without the overhead of a call for each."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from model.arm import Arm
from model.checks import LARGEST, is_several, literal
from model.cross_section.sections import LEAST_STRETCH
from model.effects import ExactTendons, SelfContact
from model.equilibrium.linearised import Linearised
from model.equilibrium.load_steps import Collocation
from model.errors import CollapsedError, InputError, OctoplanError, UnsettledSectionError
from model.forward import (
    Maps,
    checked_accuracy,
    first_pair,
    larger_estimate,
    maps_of,
    next_refinement,
    no_estimate,
)
from model.loads import contacts, is_loaded
from model.machine.compiled import Compile, checked_compile
from model.paths import Array
from model.progress import check_time
from model.rotations import matrices
from model.scene import Scene
from model.settle import ACCURACY, loosest, scene_of, settle
from model.shape import at_ends
from model.text import MOST_LINES, columns, counted, shortened_lines
from model.winches import pulls

Errors = Literal["raise", "nan"]
# Sets at a time under loads: their equations stay in the processor's cache.
_AT_ONCE = 128


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
    tensions : (m, n_tendons)
        [N].
    slack : (m, n_tendons)
        Whether each tendon is slack.
    problems : tuple of str
        Why each set is not settled, its numbers nan; empty of those that are.
    """

    tip: Array
    tip_frame: Array
    error: Array
    tensions: Array
    slack: NDArray[np.bool_]
    problems: tuple[str, ...] = ()

    def __repr__(self) -> str:
        lost = [f"  {i}: {why}" for i, why in enumerate(self.problems) if why]
        rows = [["  tips", "x [mm]", "y [mm]", "z [mm]", "error [L]"]]
        for i, (tip, error) in enumerate(zip(1e3 * self.tip, self.error, strict=True)):
            rows.append([f"  {i}", *(f"{x:.2f}" for x in tip), f"{error:.1e}"])
        said = f"{counted(len(self.tip), 'set')} of tensions, {len(lost)} not settled"
        table = shortened_lines(columns(rows), MOST_LINES + 2)
        return "\n".join([said, *table, *shortened_lines(lost)])


def _side_by_side(maps: Maps, T: Array, accuracy: float) -> tuple[Array, Array]:
    """Return the poses (M, 7) of tips under tensions (M, n_tendons), and errors (M,).

    Only those that a mesh does not settle go on to a finer one. Errors are nan of those that are to
    be settled alone: what is crushed or folded, or has no equilibrium, or none on a first mesh.
    """
    coarse, fine = first_pair(accuracy, maps.order)
    poses, errors = np.zeros((len(T), 7)), np.full(len(T), np.nan)
    estimates, last = np.full(len(T), no_estimate(maps.least_order)), np.zeros(len(T), int)
    wanted = np.full(len(T), coarse)
    near = dict[int, Linearised]()
    while wanted.any():
        check_time()
        refinement = int(wanted[wanted > 0].min())
        now, forward = np.flatnonzero(wanted == refinement), maps.on(refinement)
        before = poses[now]
        if isinstance(forward, Collocation):
            looser = loosest(accuracy) if refinement == coarse else 1.0
            least = np.full(now.size, np.nan)
            for k in range(0, now.size, _AT_ONCE):
                some = now[k : k + _AT_ONCE]
                ends = forward.many(T[some], [near[i] for i in some if i in near], looser)
                for j, (i, end) in enumerate(zip(some, ends, strict=True), k):
                    if isinstance(end, Linearised):
                        near[i], poses[i], least[j] = end, end.poses[-1], end.extremes.stretch
        else:
            tips, least = forward.many(T[now])
            poses[now] = tips[:, 0]
        wanted[now] = fine
        if refinement != coarse:
            moved = np.linalg.norm(poses[now, 4:] - before[:, 4:], axis=1)
            turned = 2 * np.linalg.norm(poses[now, :4] - before[:, :4], axis=1)
            gap = np.maximum(moved, maps.lever * turned) / maps.arm.length
            order = maps.least_order
            pair = last[now], refinement
            errors[now], estimates[now] = larger_estimate(
                estimates[now], gap, *pair, order, maps.rounding
            )
            wanted[now], late = 0, now[~(errors[now] <= accuracy)]
            finer = partial(next_refinement, refinement, accuracy=accuracy, order=order)
            wanted[late] = [*map(finer, errors[late].tolist())]
        last[now], alone = refinement, now[~(least > LEAST_STRETCH)]
        wanted[alone], errors[alone] = 0, np.nan
    errors[~(errors <= accuracy)] = np.nan
    settled = np.flatnonzero(np.isfinite(errors))
    if settled.size and maps.scene.has(ExactTendons) and not is_loaded(maps.scene):
        at = at_ends(maps.arm, maps.scene, maps.on(fine).mesh)
        errors[settled[at.folds(at.unloaded(T[settled])).any(axis=1)]] = np.nan
    return poses, errors


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
    accuracy go on to a finer one; in contact one set after the other. With `lengths`, of the same
    form [m], tendons are held by these, and settled one after the other too.

    Parameters
    ----------
    arm, scene, accuracy, compile, tendon_EA, tendon_outside
        As settle takes them.
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
    scene, accuracy = scene_of(arm, scene), checked_accuracy(accuracy)
    options: dict[str, Any] = {"compile": checked_compile(compile)}
    literal("errors", errors, Errors)
    for name, values in (("tensions", tensions), ("lengths", lengths)):
        is_wanted = values is not None or (name == "tensions" and lengths is None)
        if is_wanted and not is_several(values):
            raise InputError(name, values, f"a set of {name} for each shape to settle")
    by, sets = ("tensions", tensions) if lengths is None else ("lengths", lengths)
    if tensions is not None and len(tensions) != len(sets):
        raise InputError("tensions", f"{len(tensions)} sets", f"{len(sets)}, as of lengths")
    if lengths is not None:
        options |= {"tendon_EA": tendon_EA, "tendon_outside": tendon_outside}
    count, problems = len(sets), [""] * len(sets)
    poses, error = np.full((count, 7), np.nan), np.full(count, np.nan)
    pulling = np.full((count, arm.n_tendons), np.nan)
    if lengths is None and not (contacts(scene) or scene.has(SelfContact)):
        pulling = _rows(arm, tensions)
        allowed = np.flatnonzero(((pulling >= 0) & (pulling <= LARGEST)).all(axis=1))
        maps = maps_of(arm, scene, None, options["compile"])
        poses[allowed], error[allowed] = _side_by_side(maps, pulling[allowed], accuracy)
    slack = ~pulls(arm, pulling)
    for i in np.flatnonzero(np.isnan(error)).tolist():
        poses[i], pulling[i], slack[i] = np.nan, np.nan, False
        held = None if lengths is None else lengths[i]
        T = None if tensions is None else tensions[i]
        try:
            alone = settle(arm, T, scene, accuracy, lengths=held, **options)
        except OctoplanError as reason:
            if errors == "raise":
                raise _of_set(reason, by, i) from None
            problems[i] = str(_of_set(reason, by, i))
        else:
            poses[i], error[i] = alone.equilibrium.poses[-1], alone.error
            pulling[i], slack[i] = alone.tensions, alone.slack.ravel()
    frames = matrices(poses[:, :4])
    return Shapes(poses[:, 4:], frames, error, pulling, slack, tuple(problems))


def _rows(arm: Arm, tensions: Any) -> Array:
    """Return sets of tensions (m, n_tendons), nan of those that are no numbers for the tendons."""
    are_numbers = type(tensions) is np.ndarray and tensions.dtype == float
    if are_numbers and tensions.shape[1:] in arm.shapes:
        return np.array(tensions.reshape(len(tensions), arm.n_tendons))
    rows = np.full((len(tensions), arm.n_tendons), np.nan)
    for i, row in enumerate(tensions):
        with suppress(InputError):  # it is told where the set is settled alone
            rows[i] = arm.flat(row)
    return rows


def _of_set(reason: OctoplanError, by: str, i: int) -> OctoplanError:
    """Return an error that names the set, of what is about its tendons or a cross-section."""
    if isinstance(reason, InputError):
        field = re.sub("^(tensions|lengths)", rf"\1[{i}]", reason.field)
        return InputError(field, reason.given, reason.allowed)
    if isinstance(reason, CollapsedError | UnsettledSectionError):
        made, arguments = reason.__reduce__()
        return cast(OctoplanError, made(*arguments, which=f"{by}[{i}]"))
    return reason
