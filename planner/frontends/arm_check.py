"""Check an arm in a scene: settle random tensions in several ways, and compare the tips."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.effects.base import Effect
from octoplan.model.loads import has_complementarity
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import settle
from octoplan.model.shape import Shape
from octoplan.model.support.checks import whole
from octoplan.model.support.errors import InputError, OctoplanError
from octoplan.model.support.progress import track, with_progress
from octoplan.model.support.text import TextRepr, counted, plotted
from octoplan.planner.frontends.accuracy_study import reference_shape, verified_tip
from octoplan.planner.limits import Limits, TendonLimits, checked_limits
from octoplan.planner.planning_problem import planned_scene

# Accuracies that are compared with the reference.
ACCURACIES = (1e-2, 1e-4, 1e-6)
# Accuracies of the reference, tried in this order.
_REFERENCES = (1e-9, 1e-8, 1e-7)
# Tip error over arm length that comparisons of two equally accurate shapes allow, at least.
_ALLOWED = 1e-9
# The same in multiples of the reference accuracy.
_MARGIN = 10.0
# Accuracy of the shapes that are compared after loads and tensions changed their order.
_HISTORY_ACCURACY = 1e-7
# Distance of the tips over the arm's length above which two shapes are different equilibria.
_OTHER_EQUILIBRIUM = 1e-4
_NUMBER = re.compile(r"[-+]?\d+\.?\d*(e[-+]?\d+)?")


@dataclass(frozen=True)
class Comparison:
    """The results of one kind of comparison with the reference, over all tension sets.

    Attributes
    ----------
    name : str
        The second way to compute the shape.
    allowed : float
        Largest allowed distance of the tips over the arm's length.
    disagreements : tuple of float
        Distance of the tips over the arm's length, for each set that settled in both ways.
    refusals : tuple of str
        Errors of the sets that settled as the reference only.
    is_error : bool
        Whether a larger distance is an error. An arm may have several equilibria, so that another
        order of loads and tensions is none.
    """

    name: str
    allowed: float
    disagreements: tuple[float, ...]
    refusals: tuple[str, ...]
    is_error: bool = True

    @property
    def largest(self) -> float:
        """The largest disagreement; 0 without comparisons."""
        return max(self.disagreements, default=0.0)

    @property
    def n_beyond(self) -> int:
        """The number of disagreements above the allowed one."""
        return sum(not each <= self.allowed for each in self.disagreements)


@dataclass(frozen=True, eq=False, repr=False)
class ArmCheck(TextRepr):
    """Comparisons of the shapes of random tensions, each computed in several ways.

    Attributes
    ----------
    arm : Arm
    scene : Scene
    tensions : (m, n_tendons)
        The random tensions [N].
    settled : (m,) bool
        Whether each set has a reference shape.
    refusals : tuple of str
        Errors of the sets without a reference shape.
    comparisons : tuple of Comparison
    """

    arm: Arm
    scene: Scene
    tensions: Array
    settled: Array
    refusals: tuple[str, ...]
    comparisons: tuple[Comparison, ...]

    @property
    def n_wrong(self) -> int:
        """The number of disagreements that are errors."""
        return sum(each.n_beyond for each in self.comparisons if each.is_error)

    @property
    def passed(self) -> bool:
        """Whether at least one set settled, and no disagreement is an error."""
        return bool(self.settled.any()) and not self.n_wrong

    @property
    def outcome(self) -> str:
        """The result in one or two sentences."""
        m = self.settled.size
        text = f"{int(self.settled.sum())} of {m} tension sets settle, {len(self.refusals)} do not."
        compared = [each for each in self.comparisons if each.is_error and each.disagreements]
        if self.n_wrong:
            return f"{text} {self.n_wrong} comparisons disagree by more than allowed."
        if compared:
            worst = max(compared, key=lambda each: each.largest / each.allowed)
            text += f" All shapes agree; the largest disagreement is {worst.largest:.1e} of the "
            text += f"length ({worst.name}; {worst.allowed:.0e} is allowed)."
        others = sum(each.n_beyond for each in self.comparisons if not each.is_error)
        if others:
            text += f" {counted(others, 'set')} settled in another equilibrium if the loads act "
            text += "after the tensions; pass near= to select it."
        return text

    def reasons(self) -> list[tuple[int, str]]:
        """Return the number of refusals of each kind with an example, most frequent first.

        Messages that differ in numbers only are of one kind.
        """
        all_texts = [*self.refusals, *(t for each in self.comparisons for t in each.refusals)]
        kinds: dict[str, tuple[int, str]] = {}
        for text in all_texts:
            kind = _NUMBER.sub("#", text)
            count, example = kinds.get(kind, (0, text))
            kinds[kind] = (count + 1, example)
        return sorted(kinds.values(), key=lambda item: -item[0])

    def plot(self, ax: Any = None) -> Any:
        """Draw the disagreements of all comparisons. Return a new Figure, or the given axes."""
        return plotted(self, ax)


@with_progress
def check_arm(
    arm: Arm,
    scene: Scene | None,
    tension_max: Any = np.inf,
    *,
    limits: Limits | None = None,
    samples: int = 20,
    seed: int = 0,
    progress: bool | None = None,
) -> ArmCheck:
    """Settle random tensions in several ways, and compare the tips with a reference.

    The reference is the shape at an accuracy of 1e-9, or the finest to which the arm settles. It
    is compared with coarser accuracies, with a check by another integrator, with base and loads
    rotated together, and, under loads, with loads that act after the tensions.

    Parameters
    ----------
    arm, scene
        See settle.
    tension_max, limits
        See plan; limits of strokes are ignored. Each tendon is at its minimum with probability
        1/2, otherwise uniform between the limits. The tensions of a set above the minimum have a
        common factor, which is log-uniform from 0.01 to 1.
    samples : int
        Number of tension sets.
    seed : int
        Seed of the random numbers.
    progress : bool
        See plan.

    Raises
    ------
    InputError
        If an argument is not allowed, for example an infinite `tension_max`.
    """
    scene = planned_scene(arm, scene)
    samples = whole("samples", samples, 1)
    seed = whole("seed", seed, 0)
    bounds = checked_limits(arm, scene, tension_max, limits)
    if not np.isfinite(bounds.upper).all():
        raise InputError("tension_max", bounds.upper, "finite numbers")
    rng = np.random.default_rng(seed)
    tensions = np.array([random_tensions(bounds, rng) for _ in range(samples)])
    rotations = [random_rotation(rng) for _ in range(samples)]
    comparisons: dict[str, tuple[list[float], list[str]]] = {
        name: ([], []) for name in _names(scene)
    }
    refusals = []
    settled = np.zeros(samples, dtype=bool)
    allowed = dict.fromkeys(comparisons, _ALLOWED)
    for i, (T, rotation) in enumerate(
        track("tension sets settled", list(zip(tensions, rotations, strict=True)))
    ):
        try:
            reference, accuracy = reference_shape(arm, T, scene, _REFERENCES)
        except InputError:
            raise
        except OctoplanError as reason:
            refusals.append(str(reason))
            continue
        settled[i] = True
        for name, call in _ways(arm, scene, T, rotation, accuracy, reference).items():
            try:
                comparisons[name][0].append(call() / arm.length)
            except OctoplanError as reason:
                comparisons[name][1].append(str(reason))
            allowed[name] = max(allowed[name], _MARGIN * accuracy)
    allowed |= {_accuracy_name(a): max(a, _ALLOWED) for a in ACCURACIES}
    allowed |= {_HISTORY: _OTHER_EQUILIBRIUM}
    return ArmCheck(
        arm,
        scene,
        tensions,
        settled,
        tuple(refusals),
        tuple(
            Comparison(name, allowed[name], tuple(gaps), tuple(texts), name != _HISTORY)
            for name, (gaps, texts) in comparisons.items()
        ),
    )


_HISTORY = "loads after tensions"
_ROTATED = "base and loads rotated"
_INTEGRATED = "other integrator"


def _accuracy_name(accuracy: float) -> str:
    return f"accuracy {accuracy:.0e}"


def _names(scene: Scene) -> list[str]:
    """Return the names of the comparisons in a scene."""
    names = [*map(_accuracy_name, ACCURACIES), _INTEGRATED]
    if rotated_scene(scene, np.eye(3)) is not None:
        names.append(_ROTATED)
    if scene != scene_without_loads(scene) and not has_complementarity(scene):
        names.append(_HISTORY)
    return names


def _ways(
    arm: Arm, scene: Scene, T: Array, rotation: Array, accuracy: float, reference: Shape
) -> dict[str, Callable[[], float]]:
    """Return functions that return the distance [m] of two tips, by name of the comparison."""

    def distance_at(coarse: float) -> float:
        return math.dist(settle(arm, T, scene, coarse).tip, reference.tip)

    ways: dict[str, Callable[[], float]] = {
        _accuracy_name(each): partial(distance_at, each) for each in ACCURACIES
    }
    ways[_INTEGRATED] = lambda: math.dist(verified_tip(reference, accuracy)[0], reference.tip)
    turned = rotated_scene(scene, rotation)
    if turned is not None:
        ways[_ROTATED] = lambda: math.dist(
            settle(rotated_arm(arm, rotation), T, turned).tip,
            rotation @ settle(arm, T, scene).tip,
        )
    if _HISTORY in _names(scene):
        ways[_HISTORY] = lambda: math.dist(_tip_with_late_loads(arm, scene, T), reference.tip)
    return ways


def _tip_with_late_loads(arm: Arm, scene: Scene, T: Array) -> Array:
    """Return the tip (3,) [m] if the loads act after the tensions.

    Raises OctoplanError if the branch of equilibria ends before the loads act in full.
    """
    bent = settle(arm, T, scene_without_loads(scene), _HISTORY_ACCURACY)
    shape = settle(arm, T, scene, _HISTORY_ACCURACY, near=bent)
    if shape.history != "near":
        raise OctoplanError("the arm snaps if the loads act after the tensions")
    return shape.tip


def random_tensions(limits: TendonLimits, rng: np.random.Generator) -> Array:
    """Return tensions (n_tendons,) [N] within limits; see check_arm."""
    low = np.array(limits.lower)
    high = np.array(limits.upper)
    size = 10 ** rng.uniform(-2, 0)
    extra = size * rng.uniform(size=low.size) * (high - low) * (rng.uniform(size=low.size) < 0.5)
    if limits.total is not None and extra.sum() > limits.total - low.sum():
        extra *= max(limits.total - low.sum(), 0.0) / extra.sum()
    return np.asarray(low + extra)


def random_rotation(rng: np.random.Generator) -> Array:
    """Return a random rotation matrix (3, 3)."""
    Q, R = np.linalg.qr(rng.normal(size=(3, 3)))
    Q = Q * np.sign(np.diag(R))
    return np.asarray(Q * np.linalg.det(Q))


def rotated_arm(arm: Arm, rotation: Array) -> Arm:
    """Return an arm whose base is rotated about the origin."""
    frame = rotation @ np.array(arm.base_frame)
    position = rotation @ np.array(arm.base_position)
    return replace(
        arm,
        base_frame=tuple(map(tuple, frame.tolist())),
        base_position=tuple(position.tolist()),
    )


def rotated_scene(scene: Scene, rotation: Array) -> Scene | None:
    """Return a scene whose loads are rotated; None if an effect cannot be rotated."""
    effects: list[Effect] = []
    for effect in scene.effects:
        turned = effect.rotated(rotation)
        if turned is None:
            return None
        effects.append(turned)
    return Scene(*effects)


def scene_without_loads(scene: Scene) -> Scene:
    """Return the scene without loads."""
    return Scene(*(effect for effect in scene.effects if effect.without_force() is None))
