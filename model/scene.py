"""A scene: the effects that are enabled."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

from octoplan.model.effects.base import Effect
from octoplan.model.effects.sections import ExactTendons, Extension, NeoHookean
from octoplan.model.support.checks import kind
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.text import HtmlRepr
from octoplan.model.support.value import value

if TYPE_CHECKING:
    from octoplan.model.rod.rod_term import RodTerm

E = TypeVar("E", bound=Effect)
# Length of a line in repr [characters].
_WIDTH = 88


@value(init=False)
class Scene(HtmlRepr):
    """The effects that are simulated, in addition to bending.

    `Scene()` is the bare arm, `Scene(Extension())` the paper's scene, and `Scene.as_printed()` uses
    the paper's equations to the letter.

    Raises
    ------
    InputError
        If an argument is not an effect, if an effect occurs twice, or if effects exclude each
        other.
    """

    effects: tuple[Effect, ...]

    def __init__(self, *effects: Effect) -> None:
        for i, effect in enumerate(effects):
            kind(f"Scene effect {i + 1}", effect, Effect)
        kinds = [type(effect).__name__ for effect in effects]
        places = [_place(effect) for effect in effects]
        if len({*places}) < len(places):
            twice = next(place[0] for place in places if places.count(place) > 1)
            allowed = "each effect once (loads and masses: once at a place; contacts: a body once)"
            raise InputError("Scene", Described(f"{twice} and {twice}"), allowed)
        for effect, each in zip(effects, kinds, strict=True):
            for other, reason in effect.needs():
                if other not in kinds:
                    allowed = f"{each} with {other}: {reason}"
                    raise InputError("Scene", Described(f"{each} without {other}"), allowed)
            for other, reason in effect.excludes():
                if other in kinds:
                    raise InputError(
                        "Scene", Described(f"{each} and {other}"), f"one of them: {reason}"
                    )
        vars(self)["effects"] = tuple(sorted(effects, key=_place))

    @classmethod
    def as_printed(cls) -> Scene:
        """Return the paper's scene to the letter: eqs. (10) and (11) as printed."""
        from octoplan.model.extensions.printed import PrintedStatics

        return cls(Extension(), PrintedStatics())

    @classmethod
    def silicone(cls, *more: Effect) -> Scene:
        """Return the scene of a silicone arm: extension, exact tendons, neo-Hookean body.

        Add further effects such as weight and buoyancy: `Scene.silicone(Weight(), Buoyancy())`. A
        given effect of one of the three kinds, such as `NeoHookean(anticlastic=True)`, replaces the
        default.
        """
        parts = (Extension(), ExactTendons(), NeoHookean())
        replaced = {type(effect) for effect in more}
        return cls(*(effect for effect in parts if type(effect) not in replaced), *more)

    def __add__(self, other: Effect | Scene) -> Scene:
        """Return the scene with one more effect, or with the effects of another scene.

        Raises InputError for an effect that occurs twice, as Scene does.
        """
        if isinstance(other, Scene):
            return Scene(*self.effects, *other.effects)
        return Scene(*self.effects, other)

    def __repr__(self) -> str:
        messages = [repr(effect) for effect in self.effects]
        line = f"Scene({', '.join(messages)})"
        lines = ["Scene(", *(f"    {effect}," for effect in messages), ")"]
        return line if len(line) <= _WIDTH else "\n".join(lines)

    @cached_property
    def rod_terms(self) -> tuple[RodTerm, ...]:
        """The contributions of the effects to the rod."""
        terms = (effect.rod_term(self) for effect in self.effects)
        return tuple(term for term in terms if term is not None)

    def find(self, kind: type[E] | tuple[type[E], ...]) -> E | None:
        """Return the first effect of a kind, or of several kinds, otherwise None.

        Raises InputError if `kind` is no kind of effect and no tuple of kinds.
        """
        for each in kind if isinstance(kind, tuple) else (kind,):
            if not (isinstance(each, type) and issubclass(each, Effect)):
                raise InputError("kind", each, "a kind of effect, such as Weight, or several")
        for effect in self.effects:
            if isinstance(effect, kind):
                return effect
        return None

    def has(self, *kinds: type[Effect]) -> bool:
        """Return whether an effect of one of these kinds is enabled."""
        return self.find(kinds) is not None


def _place(effect: Effect) -> tuple[str, tuple[Any, ...]]:
    """Return the key of an effect, which is unique in a scene and determines the order."""
    return type(effect).__name__, effect.place
