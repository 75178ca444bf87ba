"""Settle many sets of tensions at once: their tips, without the overhead of a call for each."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from model.arm import Arm
from model.checks import finite_array
from model.equilibrium.equilibrium import check_stretch, stretch_of
from model.equilibrium.forward import Collocation
from model.equilibrium.linearised import Linearised
from model.errors import ConvergenceError, InputError, OctoplanError, UnsettledSectionError
from model.forward import Maps, maps_of
from model.machine.compiled import Compile, checked_compile
from model.mesh import checked_accuracy, first_pair, next_refinement
from model.paths import Array
from model.rotations import matrices
from model.scene import Scene
from model.settle import ACCURACY, checked_scene, settle
from model.shape import Shape
from model.text import MOST_LINES, columns, counted, shortened_lines
from model.time_limit import check_time
from model.transcription.layout import POSE
from model.unloaded.marched import Marched
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
        reasons = tuple(self._told.get(i, "") for i in range(len(shapes.tip)))
        if not self._told:
            return replace(shapes, problems=reasons)
        lost = self.at(np.arange(len(reasons)))
        return Shapes(
            np.where(lost[:, None], np.nan, shapes.tip),
            np.where(lost[:, None, None], np.nan, shapes.tip_frame),
            np.where(lost, np.nan, shapes.error),
            np.where(lost[:, None], np.nan, shapes.tensions),
            shapes.slack & ~lost[:, None],
            reasons,
        )


# Sets of a loaded arm that are settled side by side: factors of more would fill the memory.
_AT_ONCE = 256


class ManySets:
    """Sets of tensions (M, n_tendons) [N] of an arm in a scene, on their way to an accuracy."""

    def __init__(self, maps: Maps, T: Array, accuracy: float, problems: Problems) -> None:
        self.maps, self.T, self.accuracy, self.problems = maps, T, accuracy, problems
        self._near: list[Linearised | None] = [None] * len(T)
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
        maps, (poses, least) = self.maps, self._tips(now, refinement)
        if refinement == self.coarse:
            self.wanted[now] = self.fine
        else:
            change = poses - self.poses[now]
            gap = np.linalg.norm(change[:, 4:], axis=1)
            if maps.lever:  # of points a lever off the tip too
                gap = np.maximum(gap, 2 * maps.lever * np.linalg.norm(change[:, :4], axis=1))
            self.errors[now] = maps.error(gap, self.last[now], refinement)
        self.poses[now], self.last[now] = poses, refinement
        lost = np.isnan(poses).any(axis=1)
        settled = self.errors[now] <= self.accuracy
        for i in now[settled & ~(least > LEAST_STRETCH)]:
            with self.problems.of(int(i)):
                self._refuse_collapsed(int(i), refinement)
        if refinement != self.coarse:
            self._choose(now[~settled & ~lost], refinement)
        for i in now[lost]:
            with self.problems.of(int(i)):
                self._settle_alone(int(i))

    def _tips(self, now: Any, refinement: int) -> tuple[Array, Array]:
        """Return tip poses (k, 7) and the least 1 + q (k,) of sets by number; NaN where none is."""
        forward = self.maps.on(refinement)
        if not isinstance(forward, Collocation):
            poses, least = forward.many(self.T[now], [forward.mesh.steps])
            return poses[:, 0], least
        system = forward.system
        states = np.full((len(now), system.of.n_states), np.nan)
        for first in range(0, len(now), _AT_ONCE):
            check_time()
            some = now[first : first + _AT_ONCE]
            ends = forward.many(self.T[some], [self._near[i] for i in some.tolist()])
            for k, (i, end) in enumerate(zip(some.tolist(), ends, strict=True), first):
                if isinstance(end, OctoplanError):
                    self._near[i] = None
                    continue
                self._near[i] = Linearised(system, end.x)
                states[k] = end.states
        return states[:, system.of.nodes[-1, :POSE]], stretch_of(system, states).min(axis=1)

    def _settle_alone(self, i: int) -> None:
        """Settle a set that wants more than what is done side by side, or refuse it."""
        try:
            arguments = self.maps.arm, self.T[i], self.maps.scene, self.accuracy
            shape = settle(*arguments, compile=self.maps.machine_code)
        except UnsettledSectionError as error:
            raise UnsettledSectionError(error.s, f"tensions[{i}]") from None
        self.poses[i], self.errors[i] = shape.equilibrium.poses[-1], shape.error

    def _choose(self, now: Any, refinement: int) -> None:
        self.wanted[now] = [
            next_refinement(refinement, error, self.accuracy, self.maps.order)
            for error in self.errors[now].tolist()
        ]
        for i in now[self.wanted[now] == 0]:
            with self.problems.of(int(i)):
                self._refuse_collapsed(int(i), refinement)
                remedy = f"ask for less accuracy, or look at set {i}"
                raise ConvergenceError(self.accuracy, float(self.errors[i]), remedy)

    def _refuse_collapsed(self, i: int, refinement: int) -> None:
        forward = self.maps.on(refinement)
        if isinstance(forward, Collocation):
            self._settle_alone(i)
        else:
            check_stretch(Marched.under(forward, self.T[i]), f"tensions[{i}]")


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
    maps = maps_of(arm, scene, None, machine_code)
    return ManySets(maps, T, accuracy, problems).shapes()


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
    tips, frames, errors = np.zeros((m, 3)), np.zeros((m, 3, 3)), np.zeros(m)
    tensions, slack = np.zeros((m, n)), np.zeros((m, n), dtype=bool)
    for i, shape in enumerate(shapes):
        if shape is not None:
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
