"""Settle many sets of tensions at once: their tips, without the overhead of a call for each."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import casadi as ca
import numpy as np

from model.arm import Arm
from model.checks import finite_array
from model.errors import ConvergenceError, InputError, UnsettledSectionError
from model.forward import check_scheme, explicit_map, order_of
from model.loads import is_loaded
from model.machine.batch import Batch
from model.machine.compiled import Compile, checked_compile
from model.mesh_refinement import checked_accuracy, estimate, first_pair, next_refinement
from model.paths import Array
from model.rotations import matrices
from model.scene import Scene
from model.settle import ACCURACY, checked_scene, settle
from model.shape import Shape
from model.shapes import Errors, Problems, Shapes
from model.time_limit import check_time
from model.unloaded.closed_form import ClosedForm
from model.unloaded.pulls import PullPolynomials
from model.unloaded.statics import closed_statics
from model.unloaded.stretch import LEAST_STRETCH, check_stretch


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

    As settle; only those that a mesh does not settle to the accuracy go on to a finer one. With
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
    if is_loaded(scene):
        return _one_by_one(arm, T, scene, accuracy, machine_code, problems)
    return _Many(arm, T, scene, accuracy, machine_code, problems).shapes()


class _Many:
    """Sets of tensions on their way to the accuracy, each on the mesh that it wants next."""

    def __init__(
        self,
        arm: Arm,
        T: Array,
        scene: Scene,
        accuracy: float,
        machine_code: bool,
        problems: Problems,
    ) -> None:
        self.problems = problems
        self.arm, self.T, self.scene, self.accuracy = arm, T, scene, accuracy
        self.machine_code, self.scheme = machine_code, check_scheme(scene, None)
        self.order = order_of(self.scheme, scene)
        self.coarse, self.fine = first_pair(accuracy, self.order)
        self.poses, self.errors = np.zeros((len(T), 7)), np.full(len(T), np.inf)
        self.last, self.wanted = np.zeros(len(T), int), np.full(len(T), self.coarse)

    def shapes(self) -> Shapes:
        left = self._left(np.arange(len(self.T)))
        while left.size:
            check_time()
            refinement = int(self.wanted[left].min())
            self._step(left[self.wanted[left] == refinement], refinement)
            left = self._left(left)
        lost = self.problems.rows
        self.poses[lost, 0] = 1.0  # what has no frame is not made one of
        found = Shapes(
            self.poses[:, 4:], matrices(self.poses[:, :4]), self.errors, self.T, self.T == 0
        )
        return self.problems.kept(found)

    def _left(self, among: Any) -> Any:
        """Return those sets that are neither settled nor lost."""
        return among[~(self.errors[among] <= self.accuracy) & ~self.problems.at(among)]

    def _step(self, now: Any, refinement: int) -> None:
        """Settle the sets `now` on a mesh, and say which they want next."""
        tips = _tips(self.arm, self.scene, self.scheme, refinement, self.machine_code)
        found, least = tips(self.T[now].T)
        if refinement == self.coarse:
            self.wanted[now] = self.fine
        else:
            gap = np.linalg.norm(found[4:].T - self.poses[now, 4:], axis=1) / self.arm.length
            self.errors[now] = estimate(gap, self.last[now], refinement, self.order)
        self.poses[now], self.last[now] = found.T, refinement
        lost = np.isnan(found).any(axis=0)
        settled = self.errors[now] <= self.accuracy
        for i in now[settled & ~(least > LEAST_STRETCH)]:
            with self.problems.of(int(i)):
                self._refuse_collapsed(int(i), refinement)
        if refinement != self.coarse:
            self._choose(now[~settled & ~lost], refinement)
        for i in now[lost]:
            with self.problems.of(int(i)):
                self._settle_alone(int(i))

    def _settle_alone(self, i: int) -> None:
        """Settle a set that has a section whose equilibrium only the robust iteration finds."""
        try:
            given = (self.arm, self.T[i], self.scene, self.accuracy)
            shape = settle(*given, compile=self.machine_code)
        except UnsettledSectionError as error:
            raise UnsettledSectionError(error.s, f"tensions[{i}]") from None
        self.poses[i], self.errors[i] = shape.states[-1, :7], shape.error

    def _choose(self, now: Any, refinement: int) -> None:
        self.wanted[now] = [
            next_refinement(refinement, error, self.accuracy, self.order)
            for error in self.errors[now].tolist()
        ]
        for i in now[self.wanted[now] == 0]:
            with self.problems.of(int(i)):
                self._refuse_collapsed(int(i), refinement)
                remedy = f"ask for less accuracy, or look at set {i}"
                raise ConvergenceError(self.accuracy, float(self.errors[i]), remedy)

    def _refuse_collapsed(self, i: int, refinement: int) -> None:
        forward = explicit_map(self.arm, self.scene, self.scheme, refinement)
        check_stretch(forward, forward.run(self.T[i])[1], f"tensions[{i}]")


@lru_cache(maxsize=64)
def _tips(arm: Arm, scene: Scene, scheme: str, refinement: int, machine_code: bool) -> Any:
    """Return tensions (n_tendons, M) -> tip poses (7, M), least 1 + q.

    By tables of steps where strains are in closed form and offsets linear, else by CasADi.
    """
    forward = explicit_map(arm, scene, scheme, refinement, (), machine_code)
    if isinstance(forward, ClosedForm):
        polynomials = PullPolynomials.of(arm, closed_statics(scene, arm))
        if polynomials is not None:
            return partial(Batch(forward, polynomials).tips, machine_code=machine_code)
    T = ca.MX.sym("T", arm.n_tendons)
    poses, stretch = forward.function(T)[:2]
    function = ca.Function("tips", [T], [poses[:, -1], ca.mmin(stretch)])

    def tips(tensions: Array) -> tuple[Array, Array]:
        found, least = function(tensions)
        return np.array(found), np.array(least)[0]

    return tips


def _one_by_one(
    arm: Arm, T: Array, scene: Scene, accuracy: float, machine_code: bool, problems: Problems
) -> Shapes:
    shapes: list[Shape | None] = [None] * len(T)
    for i, row in enumerate(T):
        if not problems.at(i):
            with problems.of(i):
                shapes[i] = settle(arm, row, scene, accuracy, compile=machine_code)
    return _of(arm, shapes, problems)


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
