"""Central differences, and derivatives held to them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def fourth_order(f: Callable[[float], Array], h: float) -> Array:
    """The derivative of f at 0 by the central formula of four points."""
    return np.asarray((f(-2 * h) - 8 * f(-h) + 8 * f(h) - f(2 * h)) / (12 * h))


def check_rows(matrix: Array, way: Array, wanted: Array) -> None:
    """Hold what each row of a matrix says of a way to 1e-7 of its largest terms."""
    size = np.abs(matrix) @ np.abs(way)
    assert size.max() > 0
    assert np.all(np.abs(matrix @ way - wanted) <= 1e-7 * size + 1e-9 * size.max())
