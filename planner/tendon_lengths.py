"""Plans for winches: lengths, strokes, and how wrong a shape gets by a wrong length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model import Shape, length_response
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
    """Return how the tip of a shape answers to wrong lengths; see model.length_response."""
    found = length_response(shape)
    taut = np.flatnonzero(found.taut)
    names = tuple(shape.arm.tendon_name(int(j)) for j in taut)
    return LengthError(names, np.linalg.norm(found.tip[:, taut], axis=0))


def strokes(shape: Shape) -> Array:
    """Return what winches have taken in from the straight arm at rest (n_tendons,) [m]."""
    left = shape.tendon_lengths
    if shape.winches is not None:
        left = np.where(shape.winches.held, shape.winches.lengths, left)
    return np.asarray(rest_lengths(shape.arm) - left)
