"""The values along an axis of a sweep: a grid, or draws that a seed alone determines."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

from model.errors import InputError
from planner.sweeps.tables import AxisTable

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
    values : tuple
        Numbers, texts or booleans, in the key's own unit.
    drawn : bool
        Whether they were drawn at random: such axes vary together.
    unit : str
        Of the values; empty where the key has none.
    """

    key: str
    name: str
    values: tuple[Any, ...]
    drawn: bool
    unit: str

    @property
    def extremes(self) -> tuple[Any, ...]:
        """The least and largest of its numbers; all of its values where they are no numbers."""
        if all(isinstance(v, int | float) and not isinstance(v, bool) for v in self.values):
            return tuple(dict.fromkeys((min(self.values), max(self.values))))
        return tuple(dict.fromkeys(self.values))


def values_of(table: AxisTable, draws: int | None, seed: int) -> tuple[Any, ...]:
    """Return the values of an axis; InputError that names the key for what does not go together."""
    kind = _kind(table)
    if table.values is not None:
        return _of_a_kind(table.values)
    if table.start is not None and table.stop is not None and table.count is not None:
        return tuple(np.linspace(table.start, table.stop, table.count).tolist())
    if draws is None:
        raise InputError("distribution", kind, "draws = N in [sweep] with it: how many to draw")
    share = _stream(table.key, seed).random(draws)
    low, high = table.low, table.high
    if low is not None and high is not None and not low < high:
        raise InputError("high", high, f"above low, which is {low:g}")
    if kind == "normal":
        return _normal(table, share)
    assert low is not None and high is not None
    if kind == "uniform":
        return tuple((low + (high - low) * share).tolist())
    if low <= 0:
        raise InputError("low", low, "above 0 for a log-uniform distribution")
    return tuple((low * np.exp(math.log(high / low) * share)).tolist())


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


def _stream(key: str, seed: int) -> np.random.Generator:
    """Return the random numbers of a key: another axis more or less does not change them."""
    own = int.from_bytes(hashlib.sha256(key.encode()).digest()[:8], "little")
    return np.random.default_rng([seed, own])


def _normal(table: AxisTable, share: Any) -> tuple[float, ...]:
    """Return normal draws, cut off at low and high, by the inverse of the distribution."""
    assert table.mean is not None and table.sd is not None
    normal = NormalDist(table.mean, table.sd)
    least = 0.0 if table.low is None else normal.cdf(table.low)
    most = 1.0 if table.high is None else normal.cdf(table.high)
    if not least < most:
        raise InputError("low, high", [table.low, table.high], "limits that the draws can meet")
    inside = np.clip(least + (most - least) * share, 1e-300, 1 - 1e-16)
    return tuple(normal.inv_cdf(x) for x in inside.tolist())
