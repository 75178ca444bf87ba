"""The values along an axis of a sweep: a grid, or draws that a seed alone determines."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

from model.errors import InputError
from planner.sweeps.tables import AxisTable
from planner.sweeps.values import Draws, Even, Listed

_KINDS = {
    "values": ({"values"}, set[str]()),
    "start, stop and count": ({"start", "stop", "count"}, set[str]()),
    "uniform": ({"distribution", "low", "high"}, set[str]()),
    "log-uniform": ({"distribution", "low", "high"}, set[str]()),
    "normal": ({"distribution", "mean", "sd"}, {"low", "high"}),
}


@dataclass(frozen=True)
class Axis:
    """A value of the scene that varies.

    Attributes
    ----------
    key : str
        Key path of the value in the scene.
    name : str
        In the Dataset.
    values : Listed, Even or Draws
        In the key's own unit.
    unit : str
        Of the values; empty where the key has none.
    """

    key: str
    name: str
    values: Listed | Even | Draws
    unit: str

    @property
    def drawn(self) -> bool:
        """Whether the values were drawn at random: such axes vary together."""
        return isinstance(self.values, Draws)


def values_of(table: AxisTable, draws: int | None, seed: int) -> Listed | Even | Draws:
    """Return the values of an axis; InputError that names the key for what does not go together."""
    kind = _kind(table)
    if table.values is not None:
        return Listed(_of_a_kind(table.values))
    if table.start is not None and table.stop is not None and table.count is not None:
        return Even(table.start, table.stop, table.count)
    if draws is None:
        raise InputError("distribution", kind, "draws = N in [sweep] with it: how many to draw")
    low, high = table.low, table.high
    if low is not None and high is not None and not low < high:
        raise InputError("high", high, f"above low, which is {low:g}")
    if kind == "log-uniform" and (low is None or low <= 0):
        raise InputError("low", low, "above 0 for a log-uniform distribution")
    # Another axis more or less does not change these draws.
    own = int.from_bytes(hashlib.sha256(table.key.encode()).digest()[:8], "little")
    found = Draws(kind, low, high, table.mean, table.sd, draws, (seed, own))
    if kind == "normal":
        found.cut()
    return found


def _of_a_kind(values: list[Any]) -> tuple[Any, ...]:
    """Return values that are all numbers, all texts or all true and false; else InputError."""
    kinds = {"number" if type(v) in (int, float) else type(v).__name__ for v in values}
    if len(kinds) > 1:
        raise InputError("values", values, "numbers, or texts, or true and false; not a mix")
    return tuple(values)


def _kind(table: AxisTable) -> str:
    """Return which kind of axis a table is, by the keys that it has; InputError for a mix."""
    own = ("values", "start", "stop", "count", "distribution", "low", "high", "mean", "sd")
    given = {key for key in own if getattr(table, key) is not None}
    kinds = [table.distribution] if table.distribution else ["values", "start, stop and count"]
    for kind in kinds:
        must, may = _KINDS[kind]
        if must <= given <= must | may:
            return kind
    if table.distribution:
        must, may = _KINDS[table.distribution]
        more = f" (and, to cut it off, {', '.join(sorted(may))})" if may else ""
        told = f"{', '.join(sorted(must - {'distribution'}))}{more} with {table.distribution}"
    else:
        told = "values; or start, stop and count; or distribution with low and high"
    raise InputError("axis", sorted(given), told)
