"""Whether sections settle, and whether they have any length left."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from model.errors import CollapsedError, UnsettledSectionError
from model.paths import Array

# Exact tendons keep a crushed section from turning inside out: what is left of its length then is
# the width that keeps their roots smooth (see model.cross_section.law), and no shape.
LEAST_STRETCH = 1e-7


class Map(Protocol):
    """A forward map, of which it matters here at which arc lengths it gives 1 + q."""

    stretch_at: Array


def check_sections(forward: Map, stretch: Array, which: str = "") -> None:
    """Refuse a shape whose 1 + q (K,) is not a number where a section has no equilibrium.

    `which` says which of many shapes it is. Raises UnsettledSectionError.
    """
    if np.isnan(stretch).any():
        raise UnsettledSectionError(float(forward.stretch_at[np.argmax(np.isnan(stretch))]), which)


def check_stretch(forward: Map, stretch: Array, which: str = "") -> None:
    """Refuse a shape whose 1 + q (K,) at the places that `forward` looks at is not above 0.

    Raises CollapsedError, and as check_sections does.
    """
    check_sections(forward, stretch, which)
    worst = int(np.argmin(stretch))
    if not stretch[worst] > LEAST_STRETCH:
        raise CollapsedError(float(forward.stretch_at[worst]), float(stretch[worst]), which)
