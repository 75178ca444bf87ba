"""Planning problems: arm, scene, targets, limits, environment and options, and their checks.

Functions of this file raise InputError for arguments that are not allowed.
"""

from __future__ import annotations

from collections.abc import Iterable
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import numpy as np
from msgspec import Meta

from octoplan.model.arm import Arm
from octoplan.model.effects.sections import Extension
from octoplan.model.forward import FINEST, FINEST_ACCURACY
from octoplan.model.loads import has_unique_equilibrium
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.settle import checked_scene, settle
from octoplan.model.shape import Shape
from octoplan.model.support.errors import Described, InputError
from octoplan.planner.limits import TendonLimits
from octoplan.planner.targets.base import Target, as_targets
from octoplan.planner.targets.target_set import TargetSet

if TYPE_CHECKING:
    from octoplan.model.extensions.obstacles import Moving
    from octoplan.model.extensions.obstacles.base import Obstacle
    from octoplan.planner.block import Placement

Norm = Literal["2", "1", "inf"]
Mode = Literal["exact", "closest", "nearest"]
# Default for the largest number of initial guesses.
MAX_GUESSES = 14


@dataclass(frozen=True)
class NlpOptions:
    """Options of the nonlinear program.

    Attributes
    ----------
    norm : "2", "1" or "inf"
        Norm of the tensions that is minimised.
    mode : "exact", "closest" or "nearest"
        Treatment of the targets; see octoplan.planner.program. The search chooses the mode.
    refinement : int
        Refinement of the mesh. An element has three Gauss stages. The search chooses the mesh.
    margin : float
        Smallest accepted stability; see octoplan.planner.certificate.
    modes : 0 or 1
        Number of least stable modes of the arm that the program constrains by a row. With 0,
        stability is only checked. `mode` is the treatment of the targets.
    floor : float
        Smallest stability that a program or a descent requires. An arm that is about to
        yield does not settle.
    """

    norm: Norm = "2"
    mode: Mode = "exact"
    refinement: Annotated[int, Meta(ge=1, le=FINEST)] = 4
    margin: float = 0.0
    modes: Annotated[int, Meta(ge=0, le=1)] = 0
    floor: float = 1e-2

    @property
    def stability_bound(self) -> float:
        """The lower bound of the stability of constrained modes and of descents."""
        return max(self.margin, self.floor)

    def replace(self, **changes: Any) -> NlpOptions:
        """Return the options with some values replaced."""
        return replace(self, **changes)


@dataclass(frozen=True)
class Environment:
    """The bodies that an arm keeps clear of.

    Attributes
    ----------
    obstacles : tuple of Obstacle
    clearance : float
        Smallest allowed distance between the arm's surface and the bodies [m].
    of_itself : bool
        Whether the arm keeps the same distance from itself and from the far side of its base plane.
    moving : tuple of Moving
        Moving obstacles, of motions.
    """

    obstacles: tuple[Obstacle, ...] = ()
    clearance: float = 0.0
    of_itself: bool = False
    moving: tuple[Moving, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.obstacles) or self.of_itself or bool(self.moving)

    def at(self, t: float) -> Environment:
        """Return the environment at a time [s], with every obstacle at rest."""
        placed = tuple(obstacle.at(t) for obstacle in self.moving)
        return replace(self, obstacles=self.obstacles + placed, moving=())

    @property
    def keywords(self) -> dict[str, Any]:
        """The obstacles at rest and the clearance as keywords of `plan`."""
        return {
            "obstacles": self.obstacles,
            "clearance": self.clearance if self.obstacles or self.of_itself else 0.0,
            "self_clearance": self.of_itself,
        }


NOTHING = Environment()


@dataclass(frozen=True)
class PlanningProblem:
    """A planning problem: find the least tensions that give an arm a wanted shape.

    Attributes
    ----------
    arm : Arm
    targets : tuple of Target
    scene : Scene
    limits : TendonLimits
        Limits of all tendons. `allowed` fixes the tendons that a target excludes.
    options : NlpOptions
        The search replaces mode, mesh and margin. The problem of a plan has the last options.
    accuracy : float
        Tolerance of residuals over the arm's length, of angles in rad.
    environment : Environment
        The bodies that the arm keeps clear of.
    placement : Placement or None
        Joints that move the base; the arm has its base at the joint values of the placement.
    machine_code : bool
        Whether to use compiled kernels.
    guesses : int or None
        Number of initial guesses. With None, the search stops once enough optima are equal, and
        after `MAX_GUESSES`.
    best_margin : bool
        Whether to accept less than the stability margin if the margin cannot be attained.
    mesh : int
        Refinement of the search's mesh. 0 selects a mesh for arms that bend by less than a turn.
    """

    arm: Arm
    targets: tuple[Target, ...]
    scene: Scene
    limits: TendonLimits
    options: NlpOptions
    accuracy: float
    environment: Environment = NOTHING
    placement: Placement | None = None
    machine_code: bool = field(default=False, kw_only=True, compare=False)
    guesses: int | None = field(default=None, kw_only=True, compare=False)
    best_margin: bool = field(default=False, kw_only=True, compare=False)
    mesh: int = field(default=0, kw_only=True, compare=False)

    @property
    def max_guesses(self) -> int:
        """The largest number of initial guesses."""
        return MAX_GUESSES if self.guesses is None else self.guesses

    @cached_property
    def target_set(self) -> TargetSet:
        """All targets as one; they refer to the base at joint values 0."""
        arm = self.arm if self.placement is None else self.placement.home
        return target_set(arm, self.targets)

    @property
    def base_joints(self) -> tuple[float, ...]:
        """The joint values of the base; empty for a fixed base."""
        return () if self.placement is None else self.placement.values

    @property
    def base_keywords(self) -> dict[str, Any]:
        """The base joints as a keyword of `plan`."""
        return {} if self.placement is None else {"base": self.placement.joints}

    def at_base(self, values: tuple[float, ...]) -> PlanningProblem:
        """Return the problem of the arm at joint values of the base, at 0 for no values."""
        if self.placement is None or values == self.placement.values:
            return self
        placement = self.placement.at(values)
        return replace(self, arm=placement.arm, placement=placement)

    @property
    def unloaded_scene(self) -> Scene:
        """The scene without loads in the paper's balance, which has closed forms of the strains."""
        return Scene(*[Extension()] * self.scene.has(Extension))

    @cached_property
    def allowed(self) -> TendonLimits:
        """The limits, with excluded tendons fixed at the minimum tension."""
        return self.limits.of_tendons(self.target_set.tendons)

    @property
    def n_controls(self) -> int:
        """The number of unknowns that can meet targets: tendons that can pull, and base joints."""
        can_pull = int(np.greater(self.allowed.upper, self.allowed.lower).sum())
        blocks = () if self.placement is None else self.placement.blocks(self.options.norm)
        return can_pull + sum(block.n_controls for block in blocks)

    @property
    def reference_accuracy(self) -> float:
        """The accuracy of verifying shapes: a hundredth of the problem's accuracy."""
        return max(self.accuracy / 100, FINEST_ACCURACY)

    def settled(self, tensions: Array, near: Shape | None = None) -> Shape:
        """Settle tensions to the reference accuracy; raises the errors of settle.

        A shape `near` saves the load path from rest. It is used if the arm may have several
        equilibria, because other arms settle as fast from rest. Its base may be elsewhere.

        The error of a shape is that of the tip position over the arm's length. The error of the tip
        frame, which targets use too, can be thirty times as large.
        """
        if near is not None and not has_unique_equilibrium(self.arm, self.scene):
            return settle(
                self.arm,
                tensions,
                self.scene,
                self.reference_accuracy,
                near=near if self.placement is None else replace(near, arm=self.arm),
                compile=self.machine_code,
            )
        T = tuple(np.ravel(tensions).tolist())
        return _settled(self.arm, T, self.scene, self.reference_accuracy, self.machine_code)

    def coarse(self, mode: Mode) -> NlpOptions:
        """Return options for a coarse mesh with an error of about 1e-4 of the arm's length.

        Without extension a slender tip winds up further, which takes a finer mesh.
        """
        usual = 1 if self.scene.has(Extension) else 2
        return self.options.replace(mode=mode, refinement=self.mesh or usual)


def target_set(arm: Arm, targets: tuple[Target, ...]) -> TargetSet:
    """Return targets as one, shared by all problems with equal targets."""
    try:
        return _target_set(arm, targets)
    except TypeError:
        # A target of a script may have no hash.
        return TargetSet(arm, targets)


@lru_cache(maxsize=8)
def _target_set(arm: Arm, targets: tuple[Target, ...]) -> TargetSet:
    return TargetSet(arm, targets)


@lru_cache(maxsize=8)
def _settled(
    arm: Arm, tensions: tuple[float, ...], scene: Scene, accuracy: float, machine_code: bool
) -> Shape:
    return settle(arm, tensions, scene, accuracy, compile=machine_code)


def effort(tensions: Array, norm: Norm) -> Array:
    """Return the norms (...) of tensions (..., n_tendons) [N]."""
    return np.asarray(np.linalg.norm(tensions, float(norm), axis=-1))


def planned_scene(arm: Arm, scene: Scene | None) -> Scene:
    """Return the scene, or that of the bare arm for None.

    Raises InputError for scenes without plans.
    """
    scene = checked_scene(arm, scene, contact=True)
    for effect in scene.effects:
        effect.check_planned()
    return scene


def checked_options(targets: tuple[Target, ...], limits: TendonLimits, norm: Any) -> NlpOptions:
    """Return the options for arguments of `plan`; raise InputError."""
    unbounded = limits.total is None and bool(np.isinf(limits.upper).any())
    if unbounded and any(target.compliance_request() for target in targets):
        raise InputError("tension_max", np.inf, "finite if a target requires a stiffness")
    if str(norm) not in get_args(Norm):
        allowed = "2 (least squares), 1 (least total pull) or inf (least maximum)"
        raise InputError("norm", norm, allowed)
    return NlpOptions(str(norm))  # type: ignore[arg-type]


def check_targets(arm: Arm, target: Target | Iterable[Target]) -> tuple[Target, ...]:
    """Return copies of the targets; raises InputError for misfits and contradictions.

    Plans keep copies, so that later changes of the given objects do not change the problem.
    """
    targets = as_targets(target)
    if not targets:
        raise InputError("target", target, "a target such as TipPosition(...), or several")
    prescribed = dict[str, int]()
    copies = list[Target]()
    for i, t in enumerate(targets):
        if not isinstance(t, Target):
            given = t if any(isinstance(each, Target) for each in targets) else target
            raise InputError("target", given, "a target such as TipPosition(...), or several")
        t.check(arm)
        try:
            copies.append(deepcopy(t))
        except Exception as reason:
            allowed = f"a target that copy.deepcopy copies: {reason}"
            raise InputError("target", type(t).__name__, allowed) from reason
        for name in t.prescribed(arm):
            if name in prescribed:
                first = f"targets[{prescribed[name]}]"
                allowed = f"the only target that prescribes it; {first} does, too"
                raise InputError(f"targets[{i}]", Described(f"a {name}"), allowed)
            prescribed[name] = i
    if not target_set(arm, tuple(copies)).tendons:
        raise InputError("target", targets, "targets that let a common tendon pull")
    return tuple(copies)
