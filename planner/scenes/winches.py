"""What a scene file says of lengths that winches leave."""

from __future__ import annotations

from typing import Any

import numpy as np

from model import Arm, InputError
from model.paths import Array
from model.units import warn_of_strokes
from model.winches import Winches, rest_lengths
from planner.scenes.keys import MM
from planner.scenes.tables import SceneTable


def winches_of(arm: Arm, table: SceneTable) -> dict[str, Any]:
    """Return the further arguments of settle: none where a file has tensions alone; InputError."""
    if table.lengths_mm is None and table.strokes_mm is None:
        for key, value in (
            ("tendon_EA", table.tendon_EA),
            ("tendon_outside_mm", table.tendon_outside_mm),
        ):
            if value:
                raise InputError(key, value, "none without lengths_mm or strokes_mm")
        return {}
    if table.lengths_mm is not None and table.strokes_mm is not None:
        raise InputError("strokes_mm", "given beside lengths_mm", "one of the two")
    if table.stiffness.tendon_EA is not None:
        own = table.stiffness.tendon_EA
        raise InputError("stiffness.tendon_EA", own, "tendon_EA at the top, beside lengths")
    lengths: Any = table.lengths_mm
    if table.strokes_mm is not None:
        lengths = _left(arm, table.strokes_mm)
    metres = [[v * MM for v in row] if isinstance(row, list) else row * MM for row in lengths]
    found = {
        "lengths": metres,
        "tendon_EA": table.tendon_EA,
        "tendon_outside": table.tendon_outside_mm * MM,
    }
    Winches.of(arm, table.tensions, metres, table.tendon_EA, found["tendon_outside"])
    return found


def _left(arm: Arm, strokes: list[Any]) -> list[float]:
    """Return what is left of tendons by strokes (n_tendons,) [mm], nan where these are nan.

    Raises InputError for strokes of another form, and for more than there is of a tendon.
    """
    taken, rest = _flat(arm, strokes) * MM, rest_lengths(arm)
    for j in np.flatnonzero(np.isinf(taken) | (taken >= rest)):
        field, given = f"strokes[{j}] ({arm.tendon_name(int(j))})", f"{taken[j] / MM:g} mm"
        allowed = f"below {rest[j] / MM:.6g} mm, its length at rest, and negative where paid out"
        raise InputError(field, given, allowed)
    warn_of_strokes("strokes_mm", (taken / arm.length).tolist())
    return [*((rest - taken) / MM).tolist()]


def _flat(arm: Arm, strokes: list[Any]) -> Array:
    """Return strokes (n_tendons,) of their rows; the arm judges the form alone."""
    form = [[0.0 for _ in row] if isinstance(row, list) else 0.0 for row in strokes]
    arm.flat(form, "strokes")
    rows = [row if isinstance(row, list) else [row] for row in strokes]
    return np.array([value for row in rows for value in row], dtype=float)
