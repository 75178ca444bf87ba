"""Settle many sets of tensions together: tips only, without the overhead of one call per set."""

from __future__ import annotations

import logging
import re
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from octoplan.model.arm import Arm
from octoplan.model.cross_section.sections import LEAST_STRETCH
from octoplan.model.effects import ExactTendons
from octoplan.model.equilibrium.collocation_map import CollocationMap
from octoplan.model.equilibrium.linearised import Equilibrium
from octoplan.model.forward import (
    ForwardMaps,
    checked_accuracy,
    first_pair,
    forward_maps,
    initial_estimate,
    next_refinement,
    updated_estimate,
)
from octoplan.model.loads import has_complementarity, is_coupled
from octoplan.model.paths import Array
from octoplan.model.rotations import matrices
from octoplan.model.scene import Scene
from octoplan.model.settle import ACCURACY, initial_tolerance_factor, scene_of, settle
from octoplan.model.shape import at_ends
from octoplan.model.support.checks import LARGEST, is_several, literal, positive
from octoplan.model.support.errors import CompilerError, Described, InputError, OctoplanError
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.model.support.progress import OutOfTime, check_time
from octoplan.model.support.progress import time_limit as limit_time
from octoplan.model.support.text import MOST_LINES, columns, counted, shortened_lines
from octoplan.model.tendons import is_taut

LOG = logging.getLogger(__name__)
Errors = Literal["raise", "nan"]
# Number of sets that are solved together under loads, so that the equations fit into the cache.
_AT_ONCE = 128
# Finest refinement for batches, unless the accuracy requires a finer first mesh. On finer meshes
# the overhead of a call is small, and a slow set delays the others.
_FINEST_TOGETHER = 16
# Number of parts that a failed batch is divided into; smaller batches are solved set by set.
_PARTS = 8


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
        Error of each failed set, whose values are NaN; empty for settled sets.
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


def _settle_together(
    maps: ForwardMaps, T: Array, accuracy: float, seconds: float | None
) -> tuple[Array, Array]:
    """Return the poses (M, 7) of tips under tensions (M, n_tendons), and errors (M,).

    Errors are NaN for sets that `settle` has to solve. A batch that takes longer than one set may,
    or that raises an error, is divided, so that only a few sets share the fate of a bad one.
    """
    poses = np.full((len(T), 7), np.nan)
    errors = np.full(len(T), np.nan)
    at_once = _AT_ONCE if is_coupled(maps.arm, maps.scene) else max(len(T), 1)
    batches = [np.arange(k, min(k + at_once, len(T))) for k in range(0, len(T), at_once)]
    while batches:
        check_time()
        batch = batches.pop()
        try:
            with limit_time(seconds):
                poses[batch], errors[batch] = _side_by_side(maps, T[batch], accuracy)
        except CompilerError:
            raise
        except OutOfTime:
            check_time()
        except Exception:
            # The error belongs to one set: `settle` raises the error for this set alone.
            LOG.warning("a batch of %d sets failed and is divided", batch.size, exc_info=True)
        else:
            continue
        if batch.size > _PARTS:
            batches += np.array_split(batch, _PARTS)
    return poses, errors


def _side_by_side(maps: ForwardMaps, T: Array, accuracy: float) -> tuple[Array, Array]:
    """Return the poses (M, 7) of tips under tensions (M, n_tendons), and errors (M,).

    Sets that are not accurate on a mesh continue on a finer one, each on meshes of its own. Errors
    are NaN for sets that `settle` must solve: sets without equilibrium on some mesh, and crushed,
    folded or slowly converging sets.
    """
    coarse, fine = first_pair(accuracy)
    poses = np.zeros((len(T), 7))
    errors = np.full(len(T), np.nan)
    estimates = np.full(len(T), initial_estimate(maps.order))
    last = np.zeros(len(T), int)
    wanted = np.full(len(T), coarse)
    near: list[Equilibrium | None] = [None] * len(T)
    while wanted.any():
        check_time()
        refinement = int(wanted[wanted > 0].min())
        now = np.flatnonzero(wanted == refinement)
        forward = maps.on(refinement)
        before = poses[now]
        if isinstance(forward, CollocationMap):
            tolerance_factor = initial_tolerance_factor(accuracy) if refinement == coarse else 1.0
            least = np.full(now.size, np.nan)
            ends = forward.many(T[now], [near[i] for i in now], tolerance_factor)
            for j, (i, end) in enumerate(zip(now, ends, strict=True)):
                if isinstance(end, Equilibrium):
                    near[i] = end
                    poses[i] = end.poses[-1]
                    least[j] = end.extremes.stretch
        else:
            tips, least = forward.many(T[now])
            poses[now] = tips[:, 0]
        wanted[now] = fine
        if refinement != coarse:
            moved = np.linalg.norm(poses[now, 4:] - before[:, 4:], axis=1)
            turned = 2 * np.linalg.norm(poses[now, :4] - before[:, :4], axis=1)
            gap = np.maximum(moved, maps.lever * turned) / maps.arm.length
            order = maps.order
            pair = last[now], refinement
            errors[now], estimates[now] = updated_estimate(
                estimates[now], gap, *pair, order, forward.rounding
            )
            wanted[now] = 0
            late = now[~(errors[now] <= accuracy)]
            finer = partial(next_refinement, refinement, accuracy=accuracy, order=order)
            wanted[late] = [*map(finer, errors[late].tolist())]
        last[now] = refinement
        alone = now[~(least > LEAST_STRETCH) | (wanted[now] > max(fine, _FINEST_TOGETHER))]
        wanted[alone] = 0
        errors[alone] = np.nan
    jumps = [
        i for i, point in enumerate(near) if point is not None and point.extremes.jump is not None
    ]
    errors[jumps] = np.nan
    errors[~(errors <= accuracy)] = np.nan
    settled = np.flatnonzero(np.isfinite(errors))
    if settled.size and maps.scene.has(ExactTendons) and not is_coupled(maps.arm, maps.scene):
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
    time_limit: float | None = None,
) -> Shapes:
    """Return the tips for many sets of tensions (m, n_sections, n) or (m, n_tendons) [N].

    The results are the ones of `settle`, up to rounding. Batches of sets share meshes. `settle`
    itself solves sets that fail or converge slowly in a batch, and all sets with `lengths` (of the
    same form [m]), with contact or with SelfContact.

    Parameters
    ----------
    arm, scene, accuracy, compile, tendon_EA, tendon_outside
        As in `settle`.
    errors : "raise" or "nan"
        With "raise", the first failure ends the call with its error. With "nan", a failed set is a
        row of NaN with the reason in `problems`, as in a sweep, and the other sets are settled.
    time_limit : float
        The longest time that each set may take [s].

    Raises
    ------
    InputError, CollapsedError, ConvergenceError, SnapError, TimeLimitError
        As in `settle`, naming the set, unless `errors` is "nan". InputError for an arm, a scene or
        an option that is not allowed, in any case.
    CompilerError
        If `compile` is True, and the compiler is missing or fails.
    """
    scene = scene_of(arm, scene)
    accuracy = checked_accuracy(accuracy)
    options: dict[str, Any] = {"compile": checked_compile(compile)}
    literal("errors", errors, Errors)
    for name, values in (("tensions", tensions), ("lengths", lengths)):
        is_wanted = values is not None or (name == "tensions" and lengths is None)
        if is_wanted and not is_several(values):
            raise InputError(name, values, f"a set of {name} for each shape to settle")
    by, sets = ("tensions", tensions) if lengths is None else ("lengths", lengths)
    if tensions is not None and len(tensions) != len(sets):
        raise InputError(
            "tensions",
            Described(f"{len(tensions)} sets"),
            f"{len(sets)} sets, one for each set of lengths",
        )
    if lengths is not None:
        options |= {"tendon_EA": tendon_EA, "tendon_outside": tendon_outside}
    if time_limit is not None:
        options["time_limit"] = positive("time_limit", time_limit)
    count = len(sets)
    problems = [""] * len(sets)
    poses = np.full((count, 7), np.nan)
    error = np.full(count, np.nan)
    pulling = np.full((count, arm.n_tendons), np.nan)
    if lengths is None and not has_complementarity(scene):
        maps = forward_maps(arm, scene, options["compile"])
        pulling = _rows(arm, tensions)
        allowed = np.flatnonzero(((pulling >= 0) & (pulling <= LARGEST)).all(axis=1))
        each = maps, pulling[allowed], accuracy, time_limit
        poses[allowed], error[allowed] = _settle_together(*each)
    slack = ~is_taut(arm, pulling)
    for i in np.flatnonzero(np.isnan(error)).tolist():
        check_time()
        poses[i] = np.nan
        pulling[i] = np.nan
        slack[i] = False
        held = None if lengths is None else lengths[i]
        T = None if tensions is None else tensions[i]
        try:
            alone = settle(arm, T, scene, accuracy, lengths=held, **options)
        except CompilerError:
            raise
        except Exception as reason:
            check_time()
            failure = _of_set(reason, f"{by}[{i}]")
            if errors == "raise":
                raise failure from None
            kind = "" if isinstance(failure, OctoplanError) else f"{type(failure).__name__}: "
            problems[i] = f"{kind}{failure}"
        else:
            poses[i] = alone.equilibrium.poses[-1]
            error[i] = alone.error
            pulling[i] = alone.tensions
            slack[i] = alone.slack.ravel()
    frames = matrices(poses[:, :4])
    return Shapes(poses[:, 4:], frames, error, pulling, slack, tuple(problems))


def _rows(arm: Arm, tensions: Any) -> Array:
    """Return sets of tensions (m, n_tendons), with NaN for invalid sets."""
    are_numbers = type(tensions) is np.ndarray and tensions.dtype == float
    if are_numbers and tensions.shape[1:] in arm.shapes:
        return np.array(tensions.reshape(len(tensions), arm.n_tendons))
    rows = np.full((len(tensions), arm.n_tendons), np.nan)
    for i, row in enumerate(tensions):
        with suppress(InputError):  # `settle` raises the error for this set
            rows[i] = arm.flat(row)
    return rows


def _of_set(reason: Exception, which: str) -> Exception:
    """Return an error as that of one set, such as "tensions[3]"."""
    if isinstance(reason, InputError) and re.match("tensions|lengths", reason.field):
        field = re.sub("^(tensions|lengths)", which, reason.field)
        return InputError(field, reason.given, reason.allowed)
    if isinstance(reason, OctoplanError):
        return reason.of_set(which)
    reason.add_note(f"the failed set is {which}")
    return reason
