"""A family of hard cases: members from a seed, each checked against something independent."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from octoplan.model.support.errors import OctoplanError
from tests.oracles import Array


class WrongAnswerError(AssertionError):
    """A member that had to be refused was not, or one that had to be settled was refused."""


@dataclass(frozen=True)
class Family:
    """Cases that share one difficulty.

    Attributes
    ----------
    name : str
    tolerance : float
        Tolerance of the error that `check` returns.
    draw : Callable
        A generator of random numbers -> a member, the argument of `check`.
    check : Callable
        A member -> the largest error, or a refusal: an OctoplanError or RefusedError.
    refuses : bool
        Whether a member may be refused.
    """

    name: str
    tolerance: float
    draw: Callable[[np.random.Generator], tuple[Any, ...]]
    check: Callable[..., float]
    refuses: bool = False


class RefusedError(Exception):
    """An outcome that gives the reason for a missing result."""


@dataclass(frozen=True)
class Verdict:
    """Result of a member: error or reason of the refusal, and time [s]."""

    member: tuple[Any, ...]
    error: float
    refusal: str
    seconds: float

    def passes(self, family: Family) -> bool:
        """Return whether the member is right to the tolerance, or refused if this is allowed."""
        return family.refuses if self.refusal else self.error <= family.tolerance


def judge(family: Family, seed: int) -> Verdict:
    """Return the verdict on the member of a seed; NaN counts as an infinite error."""
    member = family.draw(np.random.default_rng(seed))
    begin = time.perf_counter()
    error, refusal = math.inf, ""
    try:
        error = float(family.check(*member))
    except (OctoplanError, RefusedError) as caught:
        refusal = f"{type(caught).__name__}: {caught}"
    except WrongAnswerError:
        pass
    error = math.inf if math.isnan(error) else error
    return Verdict(member, error, refusal, time.perf_counter() - begin)


def relative(found: Array, wanted: Array, least: float = 1e-30) -> float:
    """Return the largest distance between rows (N, k), over the largest in each or the least."""
    size = np.maximum(np.abs(wanted).max(axis=1), least)
    return float((np.abs(found - wanted).max(axis=1) / size).max())
