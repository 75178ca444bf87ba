"""Whether sections settle, and whether they have any length left."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from model.errors import CollapsedError, UnsettledSectionError
from model.paths import Array

# Exact tendons keep a crushed section from turning inside out: what is left of its length then is
# the width that keeps their roots smooth (see model.cross_section.law), and no shape.
LEAST_STRETCH = 1e-7


class Stretched(Protocol):
    """An equilibrium, of which it matters here where 1 + q is known."""

    @property
    def stretch_at(self) -> Array:
        """Arc lengths (K,) [m]."""

    @property
    def stretch(self) -> Array:
        """1 + q there (K,)."""


def check_sections(at: Stretched, which: str = "") -> None:
    """Refuse an equilibrium whose 1 + q is not a number where a section has none.

    `which` says which of many it is. Raises UnsettledSectionError.
    """
    if not np.isnan(at.stretch.sum()):
        return
    lost = np.isnan(at.stretch)
    if lost.any():
        raise UnsettledSectionError(float(at.stretch_at[np.argmax(lost)]), which)


def check_stretch(at: Stretched, which: str = "") -> None:
    """Refuse an equilibrium whose 1 + q is not above 0 somewhere.

    Raises CollapsedError, and as check_sections does.
    """
    check_sections(at, which)
    worst = int(np.argmin(at.stretch))
    if not at.stretch[worst] > LEAST_STRETCH:
        raise CollapsedError(float(at.stretch_at[worst]), float(at.stretch[worst]), which)
