"""What settled shapes predict less what was measured of them, with derivatives by the unknowns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from model import OctoplanError
from model.equilibrium.linearised import Linearised
from model.equilibrium.sensitivities import ByNumbers, along, displaced
from model.paths import Array
from model.rotations import matrices
from planner.fit.equilibria import FRAME, Family, Setting
from planner.fit.measured import Measured
from planner.fit.unknowns import Parameters

# In how many steps shapes are followed to other values that one step does not lead to.
_STEPS = (2, 6)


class UnsettledShapeError(OctoplanError):
    """A shape does not settle at given values of the unknowns."""

    def __init__(self, name: str, why: OctoplanError) -> None:
        self.name, self.why = name, why
        super().__init__(f"{name} does not settle: {why}")


class Residual(NamedTuple):
    """What is predicted less what was measured of one thing of a shape.

    `what` is a marker ("points[1]"), "tip", a frame or a tendon; `miss` in m, of frames in rad.
    """

    shape: str
    what: str
    miss: tuple[float, ...]

    @property
    def size(self) -> float:
        """The distance [m], or angle [rad]."""
        return float(np.linalg.norm(self.miss))

    @property
    def is_place(self) -> bool:
        """Whether it is a marker's or the tip's."""
        return self.what.startswith(("points", "tip"))


def mean_distance(residuals: Iterable[Residual]) -> float:
    """Return the mean distance of markers and tips from where they are predicted [m], or NaN."""
    sizes = [residual.size for residual in residuals if residual.is_place]
    return float(np.mean(sizes)) if sizes else float("nan")


class Experiment:
    """Measured shapes of one arm, with the unknowns of both, on meshes of a refinement."""

    def __init__(
        self,
        parameters: Parameters,
        shapes: Sequence[Measured],
        refinement: int,
        stages: int,
        machine_code: bool = False,
    ) -> None:
        self.parameters, self.shapes = parameters, tuple(shapes)
        self.mesh = refinement, stages, machine_code
        sessions = {unknown.session for unknown in parameters.unknowns}
        #: Which shapes are of each session that has an arm of its own; "" is all others'.
        self.members: dict[str, list[int]] = {}
        for i, shape in enumerate(self.shapes):
            self.members.setdefault(shape.session if shape.session in sessions else "", []).append(
                i
            )
        self.families = {
            name: Family(parameters, name, [self.shapes[i] for i in which], *self.mesh)
            for name, which in self.members.items()
        }

    def from_rest(self, values: Array) -> Evaluation:
        """Return all shapes at values (K,) as they are reached from rest.

        InputError where no such arm can be; shapes that have no equilibrium are `lost`.
        """
        settings = {name: family.at(values) for name, family in self.families.items()}
        reached: dict[int, Linearised | OctoplanError] = {}
        for name, which in self.members.items():
            reached |= zip(which, settings[name].from_rest(), strict=True)
        return Evaluation.of(self, values, settings, reached)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Shapes at given values (K,) of the unknowns.

    Attributes
    ----------
    experiment : Experiment
    values : (K,)
    settings : dict of Setting
        The equations of each session.
    equilibria : dict of Linearised
        By the number of their shape, in order; without those left out or lost.
    lost : dict of OctoplanError
        Why shapes have none, by their number.
    """

    experiment: Experiment
    values: Array
    settings: dict[str, Setting]
    equilibria: dict[int, Linearised]
    lost: dict[int, OctoplanError]

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        values: Array,
        settings: dict[str, Setting],
        reached: dict[int, Linearised | OctoplanError],
    ) -> Evaluation:
        """Return the evaluation of equilibria, or of why there is none, by shape."""
        rows = dict(sorted(reached.items()))
        equilibria = {i: end for i, end in rows.items() if isinstance(end, Linearised)}
        lost = {i: end for i, end in rows.items() if isinstance(end, OctoplanError)}
        return cls(experiment, values, settings, equilibria, lost)

    def near(self, values: Array, experiment: Experiment | None = None) -> Evaluation:
        """Return the shapes that this has at other values, on the same branches.

        On the meshes of this experiment or of another one of the same shapes; those that do not
        lead to an equilibrium nearby, in a few steps, are `lost`.
        """
        experiment = experiment or self.experiment
        there = self._in_one_step(values, experiment)
        if experiment is not self.experiment:
            return there
        for steps in _STEPS if there.lost else ():
            left = self.only(list(there.lost))
            for share in np.arange(1, steps) / steps:
                left = left._in_one_step(self.values + share * (values - self.values), experiment)
            last = left._in_one_step(values, experiment)
            there = Evaluation.of(
                experiment,
                values,
                there.settings,
                {**there.lost, **there.equilibria, **last.equilibria},
            )
            if not there.lost:
                break
        return there

    def _in_one_step(self, values: Array, experiment: Experiment) -> Evaluation:
        settings = {name: family.at(values) for name, family in experiment.families.items()}
        reached: dict[int, Linearised | OctoplanError] = {}
        for name, sensed in self._sensed.items():
            ends = settings[name].near(
                sensed.which, sensed.equilibria, *sensed.ahead(values - self.values)
            )
            reached |= zip(self._numbers(name), ends, strict=True)
        return Evaluation.of(experiment, values, settings, reached)

    def only(self, kept: Sequence[int]) -> Evaluation:
        """Return the evaluation with all but some shapes left out."""
        equilibria = {i: equilibrium for i, equilibrium in self.equilibria.items() if i in kept}
        return Evaluation(self.experiment, self.values, self.settings, equilibria, {})

    def _numbers(self, session: str) -> list[int]:
        """Return the numbers of a session's shapes that this has."""
        return [i for i in self.experiment.members[session] if i in self.equilibria]

    @cached_property
    def _sensed(self) -> dict[str, Sensed]:
        by_session = {}
        for name, members in self.experiment.members.items():
            which = [k for k, i in enumerate(members) if i in self.equilibria]
            if which:
                equilibria = [self.equilibria[members[k]] for k in which]
                by_session[name] = Sensed(self.settings[name], which, equilibria)
        return by_session

    def _by_shape(self, what: str) -> dict[int, Array]:
        rows = {
            i: row
            for name, sensed in self._sensed.items()
            for i, row in zip(self._numbers(name), getattr(sensed, what), strict=True)
        }
        return dict(sorted(rows.items()))

    @property
    def residuals(self) -> dict[int, Array]:
        """Predictions less measurements (size,), [m] and [rad], of each shape by number."""
        return self._by_shape("residuals")

    @property
    def jacobians(self) -> dict[int, Array]:
        """Their derivatives by the unknowns (size, K)."""
        return self._by_shape("jacobians")

    @property
    def whitening(self) -> dict[int, Array]:
        """Matrices (size, size) by which they are of unit variance, as is known."""
        return self._by_shape("whitening")

    def named(self) -> tuple[Residual, ...]:
        """Return all residuals, shape by shape."""
        shapes = self.experiment.shapes
        return tuple(
            Residual(shapes[i].name, what, tuple(row))
            for i, miss in self.residuals.items()
            for what, row in _parts(shapes[i], miss)
        )


def _parts(shape: Measured, miss: Array) -> list[tuple[str, list[float]]]:
    """Return the residuals (size,) of a shape by what was measured."""
    names = shape.place_names + [f"frames[{i}]" for i in range(len(shape.frames))]
    runs = [f"{kind}[{j}]" for kind in shape.runs for j in range(len(getattr(shape, kind)))]
    vectors = miss[: 3 * len(names)].reshape(-1, 3).tolist()
    rest = miss[3 * len(names) :].reshape(-1, 1).tolist()
    return [*zip(names, vectors, strict=True), *zip(runs, rest, strict=True)]


class Sensed:
    """What sensors show of some shapes of a session, worked out for all at once."""

    def __init__(
        self, setting: Setting, which: Sequence[int], equilibria: Sequence[Linearised]
    ) -> None:
        self.setting, self.which, self.equilibria = setting, list(which), list(equilibria)
        self.shapes = [setting.family.shapes[k] for k in which]
        order = {k: i for i, k in enumerate(which)}
        rows = [m for m, k in enumerate(setting.family.shape.tolist()) if k in order]
        self._shape = np.array([order[setting.family.shape[m]] for m in rows], dtype=np.int64)
        self._rows, self._turns = rows, setting.family.point[rows] == FRAME
        self._poses = self._at(np.array([each.states for each in equilibria]))
        self._arms = np.einsum(
            "mij,mj->mi", matrices(self._poses[:, :4]), setting.numbers.offsets[rows]
        )

    def _at(self, states: Array) -> Array:
        """Return the rows of poses among states (N, n_states, ...), one for each that is seen."""
        return np.asarray(states[self._shape[:, None], self.setting.places[self._rows]])

    @cached_property
    def _shown(self) -> Array:
        """Places [m], and rotation vectors from measured frames [rad] (M, 3)."""
        shown = self._poses[:, 4:] + self._arms
        seen = np.array([R for shape in self.shapes for _, R in shape.frames]).reshape(-1, 3, 3)
        turned = matrices(self._poses[self._turns, :4]) @ seen.transpose(0, 2, 1)
        shown[self._turns] = Rotation.from_matrix(turned).as_rotvec() if len(turned) else 0.0
        return np.asarray(shown)

    @cached_property
    def residuals(self) -> list[Array]:
        """Predictions less measurements of each shape (size,), [m] and [rad]."""
        equilibria, rest = self.equilibria, self.setting.numbers.rest
        shown = self._stacked(self._shown, lambda k: equilibria[k].lengths, rest)
        return [
            np.asarray(values - m.numbers) for values, m in zip(shown, self.shapes, strict=True)
        ]

    @cached_property
    def derivatives(self) -> list[ByNumbers]:
        """Derivatives of the equilibria by the unknowns."""
        return self.setting.differentiated(self.which, self.equilibria)

    def ahead(self, change: Array) -> tuple[Array, Array]:
        """Return by how much states (N, n_states) and tensions (N, n_tendons) are to change.

        To first order in a change (K,) of the unknowns.
        """
        if not change.any():
            of, n = self.setting.system.of, len(self.equilibria)
            return np.zeros((n, of.n_states)), np.zeros((n, of.n_tendons))
        states = np.array([by.states @ change for by in self.derivatives])
        return states, np.array([by.tensions @ change for by in self.derivatives])

    @cached_property
    def jacobians(self) -> list[Array]:
        """Derivatives of `residuals` by the unknowns, each (size, K)."""
        numbers, by = self.setting.derivatives, self.derivatives
        nodes = self.setting.nodes[self._rows]
        moved = displaced(self._poses, self._at(np.array([each.states for each in by])))
        # Of what is looked at, which need not move along with its node.
        slip = numbers.s[self._rows] - numbers.nodes[nodes]
        for m in np.flatnonzero(slip.any(axis=1)):
            moved[m] += along(by[self._shape[m]].here, nodes[m : m + 1])[0][:, None] * slip[m]
        rows = self._by_motion(moved)
        rows += matrices(self._poses[:, :4]) @ numbers.offsets[self._rows]
        return self._stacked(rows, lambda k: by[k].lengths, numbers.rest)

    @cached_property
    def whitening(self) -> list[Array]:
        """Matrices (size, size) by which residuals of each shape are of unit variance.

        Noise of what drives a shape, its tensions or its lengths, is carried to the residuals to
        first order: the effective variance. Source: Orear, American Journal of Physics 50 (1982).
        """
        if not any(shape.by_length or shape.tension_std for shape in self.shapes):
            return [np.diag(1 / shape.stds) for shape in self.shapes]
        moved = self._at(np.array([equilibrium.by_tensions for equilibrium in self.equilibria]))
        rows = self._by_motion(displaced(self._poses, moved))
        by_tensions = self._stacked(rows, lambda k: self.equilibria[k].length_tension, 0.0)
        whitening = []
        for shape, equilibrium, J in zip(self.shapes, self.equilibria, by_tensions, strict=True):
            inputs = shape.tension_std * np.diag(self.setting.numbers.scale)
            if shape.by_length:
                std = shape.length_std or shape.std
                inputs = std * self.setting.tensions_by_lengths(equilibrium)
            variance = np.diag(np.square(shape.stds)) + (J @ inputs) @ (J @ inputs).T
            whitening.append(np.linalg.inv(np.linalg.cholesky(variance)))
        return whitening

    def _by_motion(self, moved: Array) -> Array:
        """Return how what is shown changes (M, 3, K) with displacements and rotations (M, 6, K)."""
        rows: Array = moved[:, :3] + np.cross(moved[:, 3:], self._arms[:, :, None], axis=1)
        turns = self._turns
        rows[turns] = _log_slopes(self._shown[turns]) @ moved[turns, 3:]
        return np.asarray(rows)

    def _stacked(
        self, rows: Array, lengths: Callable[[int], Array], rest: Array | float
    ) -> list[Array]:
        """Return for each shape its rows of (M, 3, ...), then lengths or strokes as it has them."""
        stacks = []
        for k, shape in enumerate(self.shapes):
            parts = [rows[self._shape == k].reshape(-1, *rows.shape[2:])]
            parts += [lengths(k) if kind == "lengths" else rest - lengths(k) for kind in shape.runs]
            stacks.append(np.concatenate(parts))
        return stacks


def _log_slopes(w: Array) -> Array:
    """Return how rotation vectors w (M, 3) change with further rotations (M, 3, 3), base frame.

    1 - W / 2 + (1 / a^2 - 1 / (2 a tan(a / 2))) W^2 with W = w x and a = |w|.
    Source: Bullo, Murray, "Proportional derivative (PD) control on the Euclidean group" (1995).
    """
    a = np.maximum(np.linalg.norm(w, axis=1), 1e-4)
    W = np.cross(np.eye(3), w[:, None, :])
    factor = 1 / a**2 - 1 / (2 * a * np.tan(a / 2))
    return np.asarray(np.eye(3) - W / 2 + factor[:, None, None] * (W @ W))
