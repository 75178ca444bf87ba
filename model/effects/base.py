"""The base class of effects: frozen values, each with the rules and hooks of one effect.

A complete example of a new effect with its rod term is tests/core/model/test_magnetic_tip.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from octoplan.model.arm import Arm
from octoplan.model.paths import Array
from octoplan.model.support.checks import SUCH
from octoplan.model.support.value import value

if TYPE_CHECKING:
    from octoplan.model.forward import ForwardMap
    from octoplan.model.rod.rod_term import RodTerm
    from octoplan.model.scene import Scene
    from octoplan.model.settle import SettlingProblem
    from octoplan.model.shape import Shape

E = TypeVar("E", bound="Effect")
# Names of other effects, each with the reason why an effect needs or excludes this effect.
Rules = tuple[tuple[str, str], ...]


class EffectSet(Protocol):
    """The effects of a scene."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """All effects."""

    def find(self, kind: type[E]) -> E | None:
        """Return the effect of a class; None if the scene has no such effect."""


@value
class Effect:
    """Base of all effects. An effect outside of a scene contributes nothing to its equations.

    Each member has a default that contributes nothing. The model calls the members and names no
    effect of an extension.
    """

    # Name of the planning strategy for scenes with the effect; see octoplan.planner.entry_points.
    plan_strategy = ""
    # Whether equilibria depend on a set of active contacts.
    has_complementarity = False
    # Whether scenes with the effect are settled by its method `settle`.
    settles_scene = False

    @property
    def is_path_dependent(self) -> bool:
        """Whether equilibria depend on the motion that leads to them."""
        return False

    @property
    def place(self) -> tuple[Any, ...]:
        """The place of the effect. A scene may contain effects of one kind at different places.

        An effect without a place, (), may occur once.
        """
        return ()

    @classmethod
    def needs(cls) -> Rules:
        """Return the names of the effects that a scene with this effect must contain."""
        return ()

    @classmethod
    def excludes(cls) -> Rules:
        """Return the names of the effects that a scene with this effect must not contain."""
        return ()

    def rod_term(self, scene: EffectSet) -> RodTerm | None:
        """Return the contribution of the effect to the rod of a scene, or None."""
        return None

    def comparable(self) -> Effect:
        """Return the effect without the values that may change between two related shapes."""
        return self

    def without_force(self) -> Effect | None:
        """Return the load with zero force; None if the effect is not a load with a strength."""
        return None

    def rotated(self, rotation: Array) -> Effect | None:
        """Return the effect in a scene that is rotated about the origin by a matrix (3, 3).

        The default is the effect itself: an effect with directions or places in the base frame
        overrides this method. None if the effect cannot be rotated.
        """
        return self

    def check_arm(self, arm: Arm) -> None:
        """Raise InputError if an arm cannot have this effect."""

    def check_supported(self, contact: bool) -> None:
        """Raise InputError if the calling function does not support this effect.

        Functions that support contact with obstacles pass `contact=True`.
        """

    def check_planned(self) -> None:
        """Raise InputError if arms in scenes with this effect are not planned."""

    def check_responses(self) -> None:
        """Raise InputError if the response of the arm to loads is undefined with this effect."""

    def remark(self, shape: Shape) -> str:
        """Return a reason not to trust a shape in scenes with the effect, otherwise ""."""
        return ""

    def forward_map(
        self, arm: Arm, scene: Scene, refinement: int, at: tuple[float, ...], machine_code: bool
    ) -> ForwardMap | None:
        """Return the forward map of a scene with this effect; None for a map of the model core.

        See octoplan.model.forward.forward_map for the parameters.
        """
        return None

    def settle(self, problem: SettlingProblem) -> Shape:
        """Return the shape of a scene with this effect, if `settles_scene`."""
        raise NotImplementedError


SUCH[Effect] = "an effect such as Extension()"
