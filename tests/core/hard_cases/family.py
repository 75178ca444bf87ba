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
    """Members that are hard in the same way.

    Attributes
    ----------
    name : str
    tolerance : float
        Of the error that `check` returns.
    draw : Callable
        A generator of random numbers -> a member, which is what `check` takes.
    check : Callable
        -> a member's worst error, or a refusal: an error of the project's tree or RefusedError.
    refuses : bool
        Whether a member may be refused.
    """

    name: str
    tolerance: float
    draw: Callable[[np.random.Generator], tuple[Any, ...]]
    check: Callable[..., float]
    refuses: bool = False


class RefusedError(Exception):
    """An outcome that says why there is no answer."""


@dataclass(frozen=True)
class Verdict:
    """What became of a member: its error, or why it was refused, and the time it took [s]."""

    member: tuple[Any, ...]
    error: float
    refusal: str
    seconds: float

    def passes(self, family: Family) -> bool:
        """Return whether the member is right to the tolerance, or refused where that is allowed."""
        return family.refuses if self.refusal else self.error <= family.tolerance


def judge(family: Family, seed: int) -> Verdict:
    """Return the verdict on the member of a seed; what is not a number is infinitely wrong."""
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
