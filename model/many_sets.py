"""Many sets of tensions on their way to an accuracy, each on the mesh that it wants next."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from model.arm import Arm
from model.equilibrium.equilibrium import check_stretch, stretch_of
from model.equilibrium.linearised import Linearised
from model.errors import ConvergenceError, OctoplanError, UnsettledSectionError
from model.forward import COLLOCATIONS, check_scheme, collocation_map, explicit_map, order_of
from model.loads import is_loaded
from model.mesh_refinement import IMPLICIT, ROUNDING, estimate, first_pair, next_refinement
from model.paths import Array
from model.rotations import matrices
from model.scene import Scene
from model.settle import settle
from model.shapes import Problems, Shapes
from model.time_limit import check_time
from model.transcription.layout import POSE
from model.unloaded.marched import Marched
from model.unloaded.sections import LEAST_STRETCH
from model.winches import pulls

# Sets of a loaded arm that are settled side by side: factors of more would fill the memory.
_AT_ONCE = 256


class Tips(Protocol):
    """What settles sets of tensions on a mesh."""

    def __call__(self, now: Any, refinement: int) -> tuple[Array, Array]:
        """Return tip poses (7, k) and the least 1 + q (k,) of sets by number; NaN where none is."""
        ...


class ManySets:
    """Sets of tensions (M, n_tendons) [N] of an arm in a scene, on their way to an accuracy."""

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
        self.order, self.lever = order_of(self.scheme, scene), 0.0
        self.rounding = IMPLICIT if self.scheme in COLLOCATIONS else ROUNDING
        self._tips: Tips = self._in_closed_form
        if is_loaded(scene):
            self.lever = float(arm.radius.evaluate(np.zeros(1), arm.length)[0][0])
            self._tips = self._under_loads
        self._known: list[Linearised | None] = [None] * len(T)
        self.coarse, self.fine = first_pair(accuracy, self.order)
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
        slack = ~pulls(self.arm, self.T)
        found = Shapes(self.poses[:, 4:], matrices(self.poses[:, :4]), self.errors, self.T, slack)
        return self.problems.kept(found)

    def _left(self, among: Any) -> Any:
        """Return those sets that are neither settled nor lost."""
        return among[~(self.errors[among] <= self.accuracy) & ~self.problems.at(among)]

    def _step(self, now: Any, refinement: int) -> None:
        """Settle the sets `now` on a mesh, and say which they want next."""
        found, least = self._tips(now, refinement)
        if refinement == self.coarse:
            self.wanted[now] = self.fine
        else:
            moved = found.T - self.poses[now]
            gap = np.linalg.norm(moved[:, 4:], axis=1)
            if self.lever:  # of points a lever off the tip too
                gap = np.maximum(gap, 2 * self.lever * np.linalg.norm(moved[:, :4], axis=1))
            coarse, gap = self.last[now], gap / self.arm.length
            self.errors[now] = estimate(gap, coarse, refinement, self.order, self.rounding)
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

    def _in_closed_form(self, now: Any, refinement: int) -> tuple[Array, Array]:
        mesh = self.scheme, refinement, (), self.machine_code
        forward = explicit_map(self.arm, self.scene, *mesh)
        poses, least = forward.many(self.T[now], [forward.mesh.steps])
        return poses[:, 0].T, least

    def _under_loads(self, now: Any, refinement: int) -> tuple[Array, Array]:
        """Return tips of sets whose equations couple the sections; some at a time."""
        mesh = (self.scheme, refinement, (), self.machine_code)
        forward = collocation_map(self.arm, self.scene, *mesh)
        system = forward.system
        states = np.full((len(now), system.of.n_states), np.nan)
        for first in range(0, len(now), _AT_ONCE):
            check_time()
            some = now[first : first + _AT_ONCE]
            heres = forward.many(self.T[some], [self._known[i] for i in some.tolist()])
            for k, (i, here) in enumerate(zip(some.tolist(), heres, strict=True), first):
                if isinstance(here, OctoplanError):
                    self._known[i] = None
                    continue
                self._known[i] = Linearised(system, here.x)
                states[k] = here.states
        tips = states[:, system.of.nodes[-1, :POSE]]
        return tips.T, stretch_of(system, states).min(axis=1)

    def _settle_alone(self, i: int) -> None:
        """Settle a set that wants more than what is done side by side, or refuse it."""
        try:
            given = (self.arm, self.T[i], self.scene, self.accuracy)
            shape = settle(*given, compile=self.machine_code)
        except UnsettledSectionError as error:
            raise UnsettledSectionError(error.s, f"tensions[{i}]") from None
        self.poses[i], self.errors[i] = shape.equilibrium.poses[-1], shape.error

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
        if is_loaded(self.scene):
            self._settle_alone(i)
            return
        forward = explicit_map(self.arm, self.scene, self.scheme, refinement)
        check_stretch(Marched.under(forward, self.T[i]), f"tensions[{i}]")
