"""An unknown number: its keys, its bounds, and what is known of it beforehand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from model.checks import finite_array
from model.errors import InputError


@dataclass(frozen=True)
class Unknown:
    """A number to be found, in the unit of its key.

    Attributes
    ----------
    key : str or tuple of str
        Path in a scene file, such as "arm.E_kPa", "arm.sections[0].angles_deg[1]" or
        "effects.friction.mu"; for a calibration also "points[1].s_mm", "points[1].offset_mm[2]"
        (the second point of each shape), and "tension_scale[0]", what the tensions of the first
        tendon are multiplied by. Several keys have the same value.
    lower, upper : float
        Bounds.
    prior : (mean, standard deviation), optional
        What is known of it beforehand.
    session : str, optional
        The measurements that it belongs to, by their session; all unless given.
    """

    key: str | tuple[str, ...]
    lower: float
    upper: float
    prior: tuple[float, float] | None = None
    session: str | None = None

    def __post_init__(self) -> None:
        keys = self.key if isinstance(self.key, tuple | list) else (self.key,)
        if not keys or not all(isinstance(key, str) for key in keys):
            raise InputError("Unknown.key", self.key, "a key path such as arm.E_kPa, or several")
        if len(set(keys)) < len(keys):
            raise InputError("Unknown.key", self.key, "each key once")
        object.__setattr__(self, "key", keys[0] if len(keys) == 1 else tuple(keys))
        ends = finite_array(f"{self.name}: bounds", (self.lower, self.upper), (2,))
        if not ends[0] < ends[1]:
            raise InputError(f"{self.name}: upper", self.upper, f"above lower, {self.lower:g}")
        object.__setattr__(self, "lower", float(ends[0]))
        object.__setattr__(self, "upper", float(ends[1]))
        if self.prior is not None:
            object.__setattr__(self, "prior", self._checked_prior(self.prior))
        if not (self.session is None or isinstance(self.session, str)):
            raise InputError(f"{self.name}: session", self.session, "the name of a session")

    def _checked_prior(self, prior: Any) -> tuple[float, float]:
        mean, std = finite_array(f"{self.name}: prior", prior, (2,)).tolist()
        if not std > 0:
            raise InputError(
                f"{self.name}: prior", prior, "a mean and a standard deviation above 0"
            )
        if not self.lower <= mean <= self.upper:
            allowed = f"a mean within the bounds, {self.lower:g} to {self.upper:g}"
            raise InputError(f"{self.name}: prior", prior, allowed)
        return mean, std

    @property
    def keys(self) -> tuple[str, ...]:
        """All keys."""
        return self.key if isinstance(self.key, tuple) else (self.key,)

    @property
    def name(self) -> str:
        """Keys, and the session where it belongs to one."""
        keys = self.key if isinstance(self.key, tuple) else (self.key,)
        return " = ".join(keys) + (f" [{self.session}]" if self.session else "")

    @property
    def range(self) -> float:
        """From the lower to the upper bound."""
        return self.upper - self.lower

    def step(self, value: float) -> float:
        """Return the step of a difference quotient at a value."""
        small = 1e-4 * abs(value) if value else np.inf
        return float(max(min(1e-5 * self.range, small), 1e-8 * self.range))
