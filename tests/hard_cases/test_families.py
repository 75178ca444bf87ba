"""Each member of each family is right to the family's tolerance, or refused in words."""

from __future__ import annotations

import pytest

from tests.hard_cases.families import FAMILIES
from tests.hard_cases.family import Family, judge

SMALL, FULL = 2, 40


def check(family: Family, seeds: range) -> None:
    for seed in seeds:
        verdict = judge(family, seed)
        told = verdict.refusal or f"error {verdict.error:.2e}"
        assert verdict.passes(family), f"seed {seed}: {told}; {verdict.member}"


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_a_few_members_are_right_or_refused(family: Family) -> None:
    check(family, range(SMALL))


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_many_members_are_right_or_refused(family: Family) -> None:
    check(family, range(SMALL, FULL))
