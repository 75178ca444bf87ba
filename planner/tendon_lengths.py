"""Plans for winches: where they are zeroed, strokes, how wrong a shape gets by a wrong length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from model import Arm, InputError, Scene, Shape, length_response, settle
from model.checks import finite_array
from model.paths import Array
from model.winches import rest_lengths


@dataclass(frozen=True, eq=False)
class LengthError:
    """How far the tip goes where a winch is off by some length.

    Attributes
    ----------
    names : tuple of str
        Of the taut tendons.
    each : (n,)
        Displacement of the tip over the error of each winch [-], as mm per mm.
    """

    names: tuple[str, ...]
    each: Array

    @property
    def worst(self) -> str:
        """Name of the tendon whose winch matters most; empty without any."""
        return self.names[int(np.argmax(self.each))] if self.names else ""


def length_error(shape: Shape) -> LengthError:
    """Return how the tip of a shape answers to wrong lengths; see model.compliance."""
    response = length_response(shape)
    taut = np.flatnonzero(response.taut)
    names = tuple(shape.arm.tendon_name(int(j)) for j in taut)
    return LengthError(names, np.linalg.norm(response.tip[:, taut], axis=0))


def strokes(shape: Shape, zero: Any = None) -> Array:
    """Return what winches have taken in from where they are zeroed (n_tendons,) [m].

    Where the shape's tendons have these lengths `zero` [m]; in the straight arm at rest unless
    given. Of a slack tendon it is the most that may be taken in without its pulling.
    """
    left = shape.tendon_lengths
    if shape.winches is not None:
        left = np.where(shape.winches.held, shape.winches.lengths, left)
    return np.asarray((rest_lengths(shape.arm) if zero is None else np.array(zero)) - left)


def zeroed_at(arm: Arm, scene: Scene, zero: Any) -> tuple[float, ...] | None:
    """Return the tendons' lengths where winches are zeroed [m]; None at the straight arm at rest.

    Parameters
    ----------
    zero : "straight", "at rest", Shape, or lengths (n_tendons,)
        The straight arm without loads; the arm as it stands in the scene without tensions; a shape
        of the arm; lengths of its tendons [m].

    Raises InputError for anything else, and as settle does where the arm does not stand in the
    scene without tensions.
    """
    if isinstance(zero, str) and zero == "straight":
        return None
    if isinstance(zero, str) and zero == "at rest":
        return zeroed_at(arm, scene, settle(arm, np.zeros(arm.n_tendons), scene))
    if isinstance(zero, Shape) and zero.arm == arm:
        return tuple(zero.tendon_lengths.tolist())
    allowed = '"straight", "at rest", a shape of this arm, or the lengths of its tendons [m]'
    if isinstance(zero, str | Shape):
        raise InputError(
            "stroke_zero", zero if isinstance(zero, str) else "of another arm", allowed
        )
    try:
        lengths = arm.flat(zero, "stroke_zero")
    except InputError:
        raise InputError("stroke_zero", zero, allowed) from None
    if lengths.min() <= 0:
        raise InputError("stroke_zero", zero, "lengths above 0 [m]")
    return tuple(finite_array("stroke_zero", lengths, (arm.n_tendons,)).tolist())
