"""Settle many sets of tensions at once: their tips, without the overhead of a call for each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from model.arm import Arm
from model.checks import finite_array
from model.equilibrium.linearised import check_stretch
from model.equilibrium.newton import Collocation
from model.errors import ConvergenceError, InputError, OctoplanError, UnsettledSectionError
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
from model.unloaded.marched import March, Marched
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


class Problems:
    """What goes wrong at sets of many: raised, or kept by the set's number."""

    def __init__(self, errors: Errors) -> None:
        if errors not in ("raise", "nan"):
            raise InputError("errors", errors, '"raise" or "nan"')
        self._raised, self._told = errors == "raise", dict[int, str]()

    @contextmanager
    def of(self, i: int) -> Iterator[None]:
        """Keep what goes wrong at a set, if it is to be kept."""
        try:
            yield
        except OctoplanError as reason:
            if self._raised:
                raise
            self._told[i] = str(reason)

    @property
    def rows(self) -> list[int]:
        """The numbers of the sets where something went wrong."""
        return list(self._told)

    def at(self, i: Any) -> Any:
        """Return whether something went wrong at each of some sets."""
        return np.isin(i, self.rows)

    def kept(self, shapes: Shapes) -> Shapes:
        """Return shapes with nan and the reason where something went wrong."""
        if not self._told:
            return replace(shapes, problems=("",) * len(shapes.tip))
        reasons = tuple(self._told.get(i, "") for i in range(len(shapes.tip)))
        lost = self.at(np.arange(len(reasons)))
        return Shapes(
            np.where(lost[:, None], np.nan, shapes.tip),
            np.where(lost[:, None, None], np.nan, shapes.tip_frame),
            np.where(lost, np.nan, shapes.error),
            np.where(lost[:, None], np.nan, shapes.tensions),
            shapes.slack & ~lost[:, None],
            reasons,
        )


class ManySets:
    """Sets of tensions (M, n_tendons) [N] of an unloaded arm, on their way to an accuracy."""

    def __init__(self, maps: Maps, T: Array, accuracy: float, problems: Problems) -> None:
        self.maps, self.T, self.accuracy, self.problems = maps, T, accuracy, problems
        self.coarse, self.fine = first_pair(accuracy, maps.order)
        self.poses, self.errors = np.zeros((len(T), 7)), np.full(len(T), np.inf)
        self.last, self.wanted = np.zeros(len(T), int), np.full(len(T), self.coarse)

    def shapes(self) -> Shapes:
        """Return the shapes; raises what its problems do not keep."""
        left = self._left(np.arange(len(self.T)))
        while left.size:
            check_time()
            refinement = int(self.wanted[left].min())
            self._step(left[self.wanted[left] == refinement], refinement)
            left = self._left(left)
        lost = self.problems.rows
        self.poses[lost, 0] = 1.0  # what has no frame is not made one of
        slack = ~pulls(self.maps.arm, self.T)
        tips, frames = self.poses[:, 4:], matrices(self.poses[:, :4])
        return self.problems.kept(Shapes(tips, frames, self.errors, self.T, slack))

    def _left(self, among: Any) -> Any:
        """Return those sets that are neither settled nor lost."""
        return among[~(self.errors[among] <= self.accuracy) & ~self.problems.at(among)]

    def _step(self, now: Any, refinement: int) -> None:
        """Settle the sets `now` on a mesh, and say which they want next."""
        maps, forward = self.maps, self.maps.on(refinement)
        assert not isinstance(forward, Collocation)
        poses, least = forward.many(self.T[now], [forward.mesh.steps])
        poses = poses[:, 0]
        if refinement == self.coarse:
            self.wanted[now] = self.fine
        else:
            change = poses - self.poses[now]
            gap = np.linalg.norm(change[:, 4:], axis=1)
            self.errors[now] = maps.error(gap, self.last[now], refinement)
        self.poses[now], self.last[now] = poses, refinement
        lost = np.isnan(poses).any(axis=1)
        settled = self.errors[now] <= self.accuracy
        for i in now[settled & ~(least > LEAST_STRETCH)]:
            with self.problems.of(int(i)):
                check_stretch(Marched.under(forward, self.T[i]), f"tensions[{i}]")
        if refinement != self.coarse:
            self._choose(now[~settled & ~lost], forward)
        for i in now[lost]:
            with self.problems.of(int(i)):
                arguments = maps.arm, self.T[i], maps.scene, self.accuracy, maps.machine_code
                shape = _settled(*arguments, int(i))
                self.poses[i], self.errors[i] = shape.equilibrium.poses[-1], shape.error

    def _choose(self, now: Any, forward: March) -> None:
        refinement, order = forward.refinement, self.maps.order
        self.wanted[now] = next_refinement(refinement, self.errors[now], self.accuracy, order)
        for i in now[self.wanted[now] == 0]:
            with self.problems.of(int(i)):
                check_stretch(Marched.under(forward, self.T[i]), f"tensions[{i}]")
                remedy = f"ask for less accuracy, or look at set {i}"
                raise ConvergenceError(self.accuracy, float(self.errors[i]), remedy)


def _settled(
    arm: Arm, tensions: Array, scene: Scene, accuracy: float, machine_code: bool, i: int
) -> Shape:
    """Return the shape of a set by itself, or raise what is wrong with it."""
    try:
        return settle(arm, tensions, scene, accuracy, compile=machine_code)
    except UnsettledSectionError as error:
        raise UnsettledSectionError(error.s, f"tensions[{i}]") from None


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
    machine_code = checked_compile(compile)
    problems = Problems(errors)
    if lengths is not None:
        winches = {"tendon_EA": tendon_EA, "tendon_outside": tendon_outside}
        held = {"lengths": lengths, "tensions": tensions}
        options = {**winches, "compile": machine_code}
        return _by_lengths(arm, held, scene, accuracy, options, problems)
    T = _stack(arm, tensions, problems)
    if not is_loaded(scene):
        maps = maps_of(arm, scene, None, machine_code)
        return ManySets(maps, T, accuracy, problems).shapes()
    return _one_by_one(
        arm, len(T), lambda i: _settled(arm, T[i], scene, accuracy, machine_code, i), problems
    )


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

    def settled(i: int) -> Shape:
        T = None if tensions is None else tensions[i]
        try:
            return settle(arm, T, scene, accuracy, lengths=lengths[i], **options)
        except InputError as reason:
            field = reason.field.replace("lengths", f"lengths[{i}]", 1)
            raise InputError(field, reason.given, reason.allowed) from None

    return _one_by_one(arm, len(lengths), settled, problems)


def _one_by_one(
    arm: Arm, count: int, settled: Callable[[int], Shape], problems: Problems
) -> Shapes:
    """Return the tips of sets that are settled one after the other, by number."""
    tips, frames, errors = np.zeros((count, 3)), np.zeros((count, 3, 3)), np.zeros(count)
    tensions, slack = np.zeros((count, arm.n_tendons)), np.zeros((count, arm.n_tendons), dtype=bool)
    for i in np.flatnonzero(~problems.at(np.arange(count))).tolist():
        with problems.of(i):
            shape = settled(i)
            tips[i], frames[i], errors[i] = shape.tip, shape.tip_frame, shape.error
            tensions[i], slack[i] = shape.tensions, shape.slack.ravel()
    return problems.kept(Shapes(tips, frames, errors, tensions, slack))


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
