"""The values along an axis of a sweep: a grid, or draws that a seed alone determines."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError
from model.paths import Array
from planner.sweeps.tables import AxisTable

# By the kind of an axis, the keys that it must have and those that it may have.
_KINDS = {
    "values": ({"values"}, set[str]()),
    "start, stop and count": ({"start", "stop", "count"}, set[str]()),
    "uniform": ({"distribution", "low", "high"}, set[str]()),
    "log-uniform": ({"distribution", "low", "high"}, set[str]()),
    "normal": ({"distribution", "mean", "sd"}, {"low", "high"}),
}


@dataclass(frozen=True, eq=False)
class Axis:
    """A value of the scene that varies.

    Attributes
    ----------
    key : str
        Key path of the value in the scene.
    name : str
        In the Dataset.
    values : (n,)
        Numbers in the key's own unit, texts, or true and false.
    unit : str
        Of the values; empty where the key has none.
    drawn : bool
        Whether the values were drawn at random: such axes vary together.
    """

    key: str
    name: str
    values: NDArray[Any]
    unit: str
    drawn: bool

    @property
    def extremes(self) -> list[Any]:
        """The least and largest number; all values where they are no numbers."""
        if self.values.dtype.kind in "if":
            return list(dict.fromkeys((self.values.min().item(), self.values.max().item())))
        return list(dict.fromkeys(self.values.tolist()))


def values_of(table: AxisTable, draws: int | None, seed: int) -> NDArray[Any]:
    """Return the values of an axis; InputError that names the key for what does not go together."""
    kind = _kind(table)
    if table.values is not None:
        return _of_a_kind(table.values)
    if table.start is not None and table.stop is not None and table.count is not None:
        return np.linspace(table.start, table.stop, table.count)
    if draws is None:
        raise InputError("distribution", kind, "draws = N in [sweep] with it: how many to draw")
    low, high = table.low, table.high
    if low is not None and high is not None and not low < high:
        raise InputError("high", high, f"above low, which is {low:g}")
    if kind == "log-uniform" and (low is None or low <= 0):
        raise InputError("low", low, "above 0 for a log-uniform distribution")
    # Another axis more or less does not change these draws.
    own = int.from_bytes(hashlib.sha256(table.key.encode()).digest()[:8], "little")
    shares = np.random.default_rng((seed, own)).random(draws)
    if kind == "normal":
        return _normal(table, shares)
    assert low is not None and high is not None
    if kind == "uniform":
        return np.asarray(low + (high - low) * shares)
    return np.asarray(low * np.exp(np.log(high / low) * shares))


def _normal(table: AxisTable, shares: Array) -> Array:
    """Return draws of a normal distribution, which `low` and `high` may cut off."""
    from scipy.special import ndtr, ndtri  # which takes long, and is seldom needed

    mean, sd = table.mean, table.sd
    assert mean is not None and sd is not None
    ends = (
        -np.inf if table.low is None else table.low,
        np.inf if table.high is None else table.high,
    )
    least, most = (ndtr((end - mean) / sd) for end in ends)
    if not least < most:
        raise InputError("low, high", [table.low, table.high], "limits that the draws can meet")
    inside = np.clip(least + (most - least) * shares, 1e-300, 1 - 1e-16)
    return np.asarray(np.clip(mean + sd * ndtri(inside), *ends))


def _of_a_kind(values: list[Any]) -> NDArray[Any]:
    """Return values that are all numbers, all texts or all true and false; else InputError."""
    kinds = {"number" if type(v) in (int, float) else type(v).__name__ for v in values}
    if len(kinds) > 1:
        raise InputError("values", values, "numbers, or texts, or true and false; not a mix")
    array = np.array(values)
    # Whole numbers that do not fit 64 bits.
    return array.astype(float) if array.dtype.kind in "uO" else array


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
        allowed = f"{', '.join(sorted(must - {'distribution'}))}{more} with {table.distribution}"
    else:
        allowed = "values; or start, stop and count; or distribution with low and high"
    raise InputError("axis", sorted(given), allowed)
