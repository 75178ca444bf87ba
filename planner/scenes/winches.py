"""What a scene file says of lengths that winches leave."""

from __future__ import annotations

from typing import Any

from model import Arm, InputError
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
        lengths = _less(arm, table.strokes_mm)
    metres = [[v * MM for v in row] if isinstance(row, list) else row * MM for row in lengths]
    found = {
        "lengths": metres,
        "tendon_EA": table.tendon_EA,
        "tendon_outside": table.tendon_outside_mm * MM,
    }
    Winches.of(arm, table.tensions, metres, table.tendon_EA, found["tendon_outside"])
    return found


def _less(arm: Arm, strokes: list[Any]) -> list[Any]:
    """Return lengths at rest less strokes [mm], in the strokes' own form."""
    rest = (rest_lengths(arm) / MM).tolist()
    if not any(isinstance(row, list) for row in strokes):
        return [a - b for a, b in zip(rest, strokes, strict=False)]
    rows = [[rest[j] for j in arm.tendons_of(i + 1)] for i in range(len(arm.sections))]
    if [len(row) for row in rows] != [len(own) for own in strokes if isinstance(own, list)]:
        return strokes
    return [[a - b for a, b in zip(*pair, strict=True)] for pair in zip(rows, strokes, strict=True)]
