"""Lengths that no shape of an arm without loads has: which tendon, and how short it could be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.arm import Arm
from model.errors import InputError
from model.unloaded.compliant_tendons import CompliantTendons
from model.unloaded.tendon_lengths import Lengths
from model.winches import Winches, least_compliance

# What tendons may lack over the arm's length, and what says that no shape has the lengths, with one
# tendon longer as well.
SHORT, _UNKNOWN = 1e-7, 1e-5
# Tendons that lack as much as another but for this share of it, of which the first is named.
_TIED = 1e-6


class UnknownLeastError(InputError):
    """No shape is found that has the lengths, nor how short they could be."""


def refuse(tendons: CompliantTendons, found: Lengths) -> None:
    """Raise InputError that names the tendon which lacks most; UnknownLeastError."""
    lacks = np.where(
        tendons.winches.held, -tendons.winches.lacks(found.lengths, found.tensions), -np.inf
    )
    j = int(np.argmax(lacks >= lacks.max() * (1 - _TIED)))
    if lacks[j] <= SHORT * tendons.arm.length:
        return
    if found.tensions[j] == 0:  # the search ended before it pulled: its least is unknown
        raise unknown_least(tendons.arm, tendons.winches, j)
    least = _least(tendons, j, found)
    nearest = f"the nearest that a shape has is {found.lengths[j]:.9g} m"
    told = f"from {least:.7g} m on" if least else f"lengths that go together, {nearest}"
    raise InputError(
        _name(tendons.arm, j),
        float(tendons.winches.lengths[j]),
        f"{told}, beside the other lengths: no shape of the arm has these",
    )


def unknown_least(arm: Arm, winches: Winches, j: int) -> UnknownLeastError:
    """Return what to raise where a tendon is longer than asked in all that is found."""
    told = "more, beside the other lengths: no shape of the arm is found that has these"
    return UnknownLeastError(_name(arm, j), float(winches.lengths[j]), told)


def _name(arm: Arm, j: int) -> str:
    return f"lengths[{j}] ({arm.tendon_name(j)})"


def _least(tendons: CompliantTendons, j: int, found: Lengths) -> float:
    """Return how short a tendon is that pulls hard beside the others [m]; 0 for unknown.

    Others that want to be shorter than they can be are unknown as well. Pulling so hard that
    these stretch by what would count as lacking tells nothing.
    """
    held, T = tendons.winches.held.copy(), tendons.winches.tensions.copy()
    hard = _UNKNOWN / 100 * tendons.arm.length / least_compliance(tendons.arm)
    pulled = np.minimum(found.tensions, hard)
    held[j], T[j] = False, pulled[j]
    other = tendons.by(replace(tendons.winches, held=held, tensions=T))
    at = other.maximum(tendons.lengths(pulled), least_compliance(tendons.arm))
    if at is None or other.lacks(at) > _UNKNOWN * tendons.arm.length:
        return 0.0
    return float(at.lengths[j])
