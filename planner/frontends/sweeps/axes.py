"""The values along an axis of a sweep: a grid, or random draws that depend on the seed only."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from octoplan.model.paths import Array
from octoplan.model.support.errors import InputError
from octoplan.model.support.value import Positive
from octoplan.planner.frontends.io.codec import Table

Distribution = Literal["uniform", "normal", "log-uniform"]
Values = Annotated[list[float | int | str | bool], Meta(min_length=1)]
MOST_POINTS = 10_000_000
Count = Annotated[int, Meta(ge=1, le=MOST_POINTS)]


class AxisTable(Table, frozen=True):
    """An axis: a key of the scene with values, with start, stop and count, or a distribution."""

    key: Annotated[str, Meta(description="key path in the scene, such as tensions[0][2]")]
    name: Annotated[str | None, Meta(description="name in the Dataset; the key by default")] = None
    values: Annotated[
        Values | None,
        Meta(description="a grid: these values"),
    ] = None
    start: Annotated[float | None, Meta(description="a grid: the first of count values")] = None
    stop: Annotated[float | None, Meta(description="a grid: the last of count values")] = None
    count: Annotated[Count | None, Meta(description="a grid: number of values")] = None
    distribution: Annotated[Distribution | None, Meta(description="random values")] = None
    low: Annotated[float | None, Meta(description="lower bound of random values")] = None
    high: Annotated[float | None, Meta(description="upper bound of random values")] = None
    mean: Annotated[float | None, Meta(description="of a normal distribution")] = None
    sd: Annotated[Positive | None, Meta(description="standard deviation of a normal one")] = None


# Required and optional keys by distribution; None for a grid.
_KINDS: dict[str | None, tuple[set[str], set[str]]] = {
    None: ({"start", "stop", "count"}, set()),
    "uniform": ({"low", "high"}, set()),
    "log-uniform": ({"low", "high"}, set()),
    "normal": ({"mean", "sd"}, {"low", "high"}),
}
_ANY = "values; or start, stop and count; or distribution with low and high"


@dataclass(frozen=True, eq=False)
class Axis:
    """A varied value of the scene.

    Attributes
    ----------
    key : str
        Key path of the value in the scene.
    name : str
        Name in the Dataset.
    values : (n,)
        Numbers in the unit of the key, texts, or booleans.
    unit : str
        Unit of the values; empty without a unit.
    drawn : bool
        Whether the values are random; random axes vary jointly.
    """

    key: str
    name: str
    values: NDArray[Any]
    unit: str
    drawn: bool

    @property
    def extremes(self) -> list[Any]:
        """Minimum and maximum of numbers; all values of other types."""
        if self.values.dtype.kind in "if":
            return list(dict.fromkeys((self.values.min().item(), self.values.max().item())))
        return list(dict.fromkeys(self.values.tolist()))


def values_of(table: AxisTable, draws: int | None, seed: int) -> NDArray[Any]:
    """Return the values of an axis; raise InputError for an invalid combination of keys."""
    cells = {key: getattr(table, key) for key in table.__struct_fields__[2:]}
    arguments = {key: item for key, item in cells.items() if item is not None}
    kind = arguments.pop("distribution", None)
    if kind is None and arguments.keys() == {"values"}:
        return _of_a_kind(arguments["values"])
    must, may = _KINDS[kind]
    if not must <= arguments.keys() <= must | may:
        more = f" (and optional bounds {', '.join(sorted(may))})" if may else ""
        allowed = f"{', '.join(sorted(must))}{more} with {kind}" if kind else _ANY
        raise InputError("axis", sorted(arguments), allowed)
    if kind is None:
        return np.linspace(arguments["start"], arguments["stop"], arguments["count"])
    if draws is None:
        raise InputError("distribution", kind, "accompanied by draws = N in [sweep]")
    low = arguments.get("low", -np.inf)
    high = arguments.get("high", np.inf)
    if not low < high:
        raise InputError("high", high, f"above low, which is {low:g}")
    if kind == "log-uniform" and low <= 0:
        raise InputError("low", low, "above 0 for a log-uniform distribution")
    # The draws of an axis do not depend on other axes.
    own_seed = int.from_bytes(hashlib.sha256(table.key.encode()).digest()[:8], "little")
    shares = np.random.default_rng((seed, own_seed)).random(draws)
    if kind == "normal":
        return _normal(arguments["mean"], arguments["sd"], (low, high), shares)
    if kind == "uniform":
        return np.asarray(low + (high - low) * shares)
    return np.asarray(low * np.exp(np.log(high / low) * shares))


def _normal(mean: float, sd: float, ends: tuple[float, float], shares: Array) -> Array:
    """Return draws of a normal distribution, truncated at both ends."""
    from scipy.stats import truncnorm  # slow to import, rarely needed

    cut = truncnorm(*((end - mean) / sd for end in ends), loc=mean, scale=sd)
    draws = np.asarray(cut.ppf(shares))
    if not np.all(np.isfinite(draws)):
        raise InputError("low, high", list(ends), "bounds within the range of the distribution")
    return draws


def _of_a_kind(values: list[Any]) -> NDArray[Any]:
    """Return values that are all numbers, all texts or all booleans; InputError for a mixture."""
    kinds = {"number" if type(v) in (int, float) else type(v).__name__ for v in values}
    if len(kinds) > 1:
        raise InputError("values", values, "all numbers, all texts, or all booleans")
    array = np.array(values)
    # Integers beyond 64 bits become floats.
    return array.astype(float) if array.dtype.kind in "uO" else array
