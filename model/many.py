"""Settle many sets of tensions at once: their tips, without the overhead of a call for each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from model.arm import Arm
from model.checks import LARGEST
from model.equilibrium.newton import Collocation
from model.errors import CollapsedError, InputError, OctoplanError, UnsettledSectionError
from model.forward import Maps, maps_of
from model.loads import is_loaded
from model.machine.compiled import Compile, checked_compile
from model.mesh import checked_accuracy, first_pair, next_refinement
from model.paths import Array
from model.rotations import matrices
from model.scene import Scene
from model.settle import ACCURACY, checked_scene, settle
from model.shape import Shape
from model.text import MOST_LINES, columns, counted, shortened_lines
from model.time_limit import check_time
from model.unloaded.sections import LEAST_STRETCH
from model.winches import pulls

Errors = Literal["raise", "nan"]


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
        rows = [
            [f"  {i}", *(f"{1e3 * x:.2f}" for x in tip), f"{error:.1e}"]
            for i, (tip, error) in enumerate(zip(self.tip, self.error, strict=True))
        ]
        head = ["  tips", "x [mm]", "y [mm]", "z [mm]", "error [L]"]
        said = f"{counted(len(rows), 'set')} of tensions, {len(lost)} not settled"
        table = columns([head, *rows[:MOST_LINES]])
        more = [f"  ... and {len(rows) - MOST_LINES} more"] if len(rows) > MOST_LINES else []
        return "\n".join([said, *table, *more, *shortened_lines(lost)])


class _Rows:
    """The rows of many sets, as they come to be settled; nan where something went wrong."""

    def __init__(self, arm: Arm, count: int, errors: Errors) -> None:
        if errors not in ("raise", "nan"):
            raise InputError("errors", errors, '"raise" or "nan"')
        self._arm, self._raised = arm, errors == "raise"
        self.problems = [""] * count
        self.tip, self.frame = np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan)
        self.error, self.tensions = np.full(count, np.nan), np.full((count, arm.n_tendons), np.nan)
        self.slack = np.zeros((count, arm.n_tendons), dtype=bool)

    @contextmanager
    def of(self, i: int) -> Iterator[None]:
        """Keep what goes wrong at a set, unless it is to be raised."""
        try:
            yield
        except OctoplanError as reason:
            if self._raised:
                raise
            self.problems[i] = str(reason)

    def fill(self, i: Any, poses: Array, error: Any, tensions: Array, slack: Any) -> None:
        """Put down what some sets are settled to."""
        self.tip[i], self.frame[i] = poses[..., 4:], matrices(poses[..., :4])
        self.error[i], self.tensions[i], self.slack[i] = error, tensions, slack

    @property
    def good(self) -> Any:
        """The numbers of the sets where nothing went wrong."""
        return np.flatnonzero([not problem for problem in self.problems])

    def settle(self, settled: Callable[[int], Shape]) -> Shapes:
        """Return the rows; sets that are not settled yet, and not wrong, by themselves."""
        for i in np.flatnonzero(np.isnan(self.error)).tolist():
            if not self.problems[i]:
                with self.of(i):
                    shape = settled(i)
                    poses, slack = shape.equilibrium.poses[-1], shape.slack.ravel()
                    self.fill(i, poses, shape.error, shape.tensions, slack)
        values = self.tip, self.frame, self.error, self.tensions, self.slack
        return Shapes(*values, tuple(self.problems))

    def stack(self, tensions: Any) -> Array:
        """Return sets of tensions (m, n_tendons), 0 of those that are not allowed."""
        if isinstance(tensions, np.ndarray) and tensions.dtype == float:
            fits = tensions.shape[1:] in self._arm.shapes
            if fits and np.all((tensions >= 0) & (tensions <= LARGEST)):
                return tensions.reshape(self.tensions.shape)
        rows = np.zeros(self.tensions.shape)
        for i, row in enumerate(tensions):
            with self.of(i):
                rows[i] = self._arm.flat(row, f"tensions[{i}]")
        return rows


def _marched(maps: Maps, T: Array, accuracy: float) -> tuple[Array, Array]:
    """Return the poses (M, 7) of tips under tensions (M, n_tendons) without loads, errors (M,).

    Side by side, and only those that a mesh does not settle go on to a finer one. Errors are nan
    of those that are to be settled alone: what is crushed, or has no equilibrium.
    """
    coarse, fine = first_pair(accuracy, maps.order)
    poses, errors = np.zeros((len(T), 7)), np.full(len(T), np.nan)
    last, wanted = np.zeros(len(T), int), np.full(len(T), coarse)
    while wanted.any():
        check_time()
        refinement = int(wanted[wanted > 0].min())
        now, forward = np.flatnonzero(wanted == refinement), maps.on(refinement)
        assert not isinstance(forward, Collocation)
        tips, least = forward.many(T[now], [forward.mesh.steps])
        before, poses[now] = poses[now], tips[:, 0]
        wanted[now] = fine
        if refinement != coarse:
            gap = np.linalg.norm(poses[now, 4:] - before[:, 4:], axis=1)
            errors[now] = maps.error(gap, last[now], refinement)
            wanted[now] = [
                0 if error <= accuracy else next_refinement(refinement, error, accuracy, maps.order)
                for error in errors[now].tolist()
            ]
        last[now] = refinement
        wanted[now[~(least > LEAST_STRETCH)]] = 0
        errors[now[~(least > LEAST_STRETCH)]] = np.nan
    errors[~(errors <= accuracy)] = np.nan
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

    As settle, but for rounding: without loads side by side, and only those that a mesh does not
    settle to the accuracy go on to a finer one; with loads one set after the other. With `lengths`,
    of the same form [m], tendons are held by these.

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
    options: dict[str, Any] = {"compile": checked_compile(compile)}
    if lengths is not None:
        options |= {"tendon_EA": tendon_EA, "tendon_outside": tendon_outside}
        return _by_lengths(arm, lengths, tensions, scene, accuracy, options, errors)
    if not hasattr(tensions, "__len__"):
        raise InputError("tensions", tensions, "a set of tensions for each shape to settle")
    rows = _Rows(arm, len(tensions), errors)
    T = rows.stack(tensions)
    if not is_loaded(scene):
        maps, good = maps_of(arm, scene, None, options["compile"]), rows.good
        poses, error = _marched(maps, T[good], accuracy)
        settled = ~np.isnan(error)
        good, T_good = good[settled], T[good[settled]]
        rows.fill(good, poses[settled], error[settled], T_good, ~pulls(arm, T_good))

    def alone(i: int) -> Shape:
        try:
            return settle(arm, T[i], scene, accuracy, **options)
        except UnsettledSectionError as error:
            raise UnsettledSectionError(error.s, f"tensions[{i}]") from None
        except CollapsedError as error:
            raise CollapsedError(error.s, error.stretch, f"tensions[{i}]") from None

    return rows.settle(alone)


def _by_lengths(
    arm: Arm,
    lengths: Any,
    tensions: Any,
    scene: Scene,
    accuracy: float,
    options: dict[str, Any],
    errors: Errors,
) -> Shapes:
    """Return the tips by sets of lengths, and of tensions where these are given in part."""
    for name, values in (("lengths", lengths), ("tensions", tensions)):
        if values is not None and not hasattr(values, "__len__"):
            raise InputError(name, values, f"a set of {name} for each shape to settle")
    if tensions is not None and len(tensions) != len(lengths):
        raise InputError("tensions", f"{len(tensions)} sets", f"{len(lengths)}, as of lengths")

    def settled(i: int) -> Shape:
        T = None if tensions is None else tensions[i]
        try:
            return settle(arm, T, scene, accuracy, lengths=lengths[i], **options)
        except InputError as reason:
            field = reason.field.replace("lengths", f"lengths[{i}]", 1)
            raise InputError(field, reason.given, reason.allowed) from None

    return _Rows(arm, len(lengths), errors).settle(settled)
