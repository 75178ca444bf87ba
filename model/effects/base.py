"""The base class of effects: frozen values, each with the rules and hooks of one effect."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from octoplan.model.support.checks import SUCH
from octoplan.model.support.value import value

if TYPE_CHECKING:
    from octoplan.model.arm import Arm
    from octoplan.model.forward import ForwardMap
    from octoplan.model.scene import Scene
    from octoplan.model.settle import SettlingProblem
    from octoplan.model.shape import Shape

# Names of other effects, each with the reason why an effect needs or excludes this effect.
Rules = tuple[tuple[str, str], ...]


@value
class Effect:
    """Base of all effects. An effect outside of a scene contributes nothing to its equations.

    Each member has a default that contributes nothing. The model calls the members and names no
    effect of an extension.
    """

    @property
    def place(self) -> tuple[Any, ...]:
        """The place of the effect. A scene may contain several effects of a kind at other places.

        Effects of kinds without a place may occur once.
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

    @property
    def couples_sections(self) -> bool:
        """Whether the effect couples or twists the cross-sections of the arm."""
        return False

    def comparable(self) -> Effect:
        """Return the effect without the values that may change between two related shapes."""
        return self

    def convergence_order(self, scene: Scene, order: int, derivatives: bool) -> int:
        """Return the order of convergence with this effect.

        Parameters
        ----------
        scene : Scene
            The scene that contains the effect.
        order : int
            The order of convergence of smooth solutions.
        derivatives : bool
            Whether the result is for derivatives of the equilibrium.
        """
        return order

    def check_arm(self, arm: Arm) -> None:
        """Raise InputError if an arm cannot have this effect."""

    def check_supported(self, contact: bool) -> None:
        """Raise InputError if the calling function does not support this effect.

        Functions that support contact with obstacles pass `contact=True`.
        """

    def check_responses(self) -> None:
        """Raise InputError if the response of the arm to loads is undefined with this effect."""

    def forward_map(
        self, arm: Arm, scene: Scene, refinement: int, at: tuple[float, ...], machine_code: bool
    ) -> ForwardMap | None:
        """Return the forward map of a scene with this effect; None for a map of the model core.

        See octoplan.model.forward.forward_map for the parameters.
        """
        return None

    def settle(self, problem: SettlingProblem) -> Shape | None:
        """Return the shape of a scene with this effect; None to solve the equilibrium directly."""
        return None


SUCH[Effect] = "an effect such as Extension()"
