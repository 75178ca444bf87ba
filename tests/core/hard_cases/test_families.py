"""Each member of each family is right to the family's tolerance, or refused in words."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from tests.core.hard_cases import (
    arms,
    doubled,
    hanging,
    helices,
    invariants,
    loads,
    plans,
    pulls,
    thin,
)
from tests.core.hard_cases.family import Family, judge

FULL = 40
FAMILIES = (
    arms.SLENDER,
    *pulls.ANY_TENSION,
    arms.CURLED,
    *pulls.COMPRESSION,
    arms.LAYOUTS,
    invariants.EXACT_VALUES,
    invariants.UNITS,
    invariants.TURNED,
    loads.HEAVY_LOADS,
    loads.STIFF_FRICTION,
    plans.ILL_POSED_PLANS,
    hanging.HANGING,
    helices.HELICES,
    thin.THIN,
    doubled.DOUBLED,
)


@pytest.mark.quick(
    "any tension, silicone-0",
    "stiff friction-0",
    "units-0",
    "ill-posed plans-0",
    "many turns-0",
    "exact values-0",
    "any tension, paper-0",
    "layouts-0",
    "any tension, exact-0",
    "slender tips-0",
    "heavy loads-0",
    "compression, silicone-0",
    "compression, paper-0",
    "compression, exact-0",
    "hanging-0",
    "helical tendons-0",
    "long thin bars-0",
    "nearly singular allocations-0",
)
@pytest.mark.parametrize("first", [0, pytest.param(1, marks=pytest.mark.slow, id="many")])
@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_members_are_right_or_refused(
    family: Family,
    first: int,
    request: pytest.FixtureRequest,
    record_property: Callable[[str, object], None],
) -> None:
    """Judge the members of some seeds; `studies.hard_cases` records its members."""
    seeds = range(first, FULL if first else request.config.getoption("--members", 1))
    found = [judge(family, seed) for seed in seeds]
    told = [(own.error, own.refusal, own.seconds, own.passes(family)) for own in found]
    record_property("tolerance", family.tolerance)
    record_property("verdicts", json.dumps(told))
    for seed, verdict in zip(seeds, found, strict=True):
        why = verdict.refusal or f"error {verdict.error:.2e}"
        assert verdict.passes(family), f"seed {seed}: {why}; {verdict.member}"
