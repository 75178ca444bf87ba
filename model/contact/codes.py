"""How nodes touch, as columns behind the rows of an equilibrium's states."""

from __future__ import annotations

import numpy as np

from model.contact.touches import Touches
from model.paths import Array
from model.transcription.system import System

# Columns: arc length, then of each obstacle how the node touches it,
# gap'' there, and whether the element beyond lies on it.
_CODES = 3
_POINT, _END, _INSIDE = 1.0, 2.0, 3.0


def codes(system: System) -> Array:
    """Return arc length and codes of each node (N + 1, 1 + 3 K)."""
    touches = Touches.of(system)
    kind = _POINT * touches.point + _END * touches.end + _INSIDE * touches.inside
    assert touches.curve is not None
    lies = np.vstack([touches.lies, np.zeros_like(touches.lies[:1])])
    codes = np.stack([kind, np.nan_to_num(touches.curve), lies], axis=2)
    return np.hstack([system.mesh.s[:, None], codes.reshape(len(codes), -1)])


def read_codes(rows: Array) -> tuple[Array, Touches]:
    """Return arc lengths (N + 1,) [m] and how nodes touch; undoes codes."""
    by_obstacle = rows[:, 1:].reshape(len(rows), -1, _CODES)
    kind = by_obstacle[:, :, 0]
    curve = np.where(kind == _POINT, by_obstacle[:, :, 1], np.nan)
    curve[curve == 0] = np.nan
    lies = by_obstacle[:-1, :, 2] > 0
    return rows[:, 0], Touches(kind == _POINT, kind == _END, kind == _INSIDE, lies, curve)
