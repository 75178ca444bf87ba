"""Limits and norms do what their names say."""

from typing import Any

import numpy as np
import pytest

from model import Arm
from planner import plan
from planner.targets import TipPosition
from tests.planner.cases import PAPER, moderate, paper_tip

ARM = Arm.from_paper("table-4")
TARGET = TipPosition(paper_tip(ARM, moderate()))


def test_each_norm_is_least_in_its_own_measure() -> None:
    plans = {norm: plan(ARM, TARGET, PAPER, 20.0, norm=norm).tensions for norm in ("2", "1", "inf")}
    measures = {"2": np.linalg.norm, "1": np.sum, "inf": np.max}
    for norm, measure in measures.items():
        least = measure(plans[norm])
        assert all(least <= measure(T) * (1 + 1e-7) for T in plans.values())
    assert plans["1"].sum() < 0.999 * plans["inf"].sum()


def test_a_total_pull_is_kept_and_costs_effort() -> None:
    free = plan(ARM, TARGET, PAPER, 20.0)
    limit = 0.5 * (free.tensions.sum() + plan(ARM, TARGET, PAPER, 20.0, norm="1").tensions.sum())
    held = plan(ARM, TARGET, PAPER, 20.0, total_pull=limit)
    assert held.certificate.passed
    assert held.tensions.sum() <= limit * (1 + 1e-9)
    assert held.effort > free.effort


def test_minima_are_kept_and_so_are_tendons_that_are_fixed() -> None:
    low, high = np.full((3, 4), 0.01), np.full((3, 4), 20.0)
    low[1, 1] = high[1, 1] = 0.3
    found = plan(ARM, TARGET, PAPER, high, tension_min=low)
    assert found.certificate.passed
    assert found.tensions[1, 1] == 0.3
    assert found.tensions.min() >= 0.01


def test_tendons_with_a_maximum_of_zero_stay_slack() -> None:
    high = np.zeros((3, 4))
    high[1] = high[2] = 20.0
    found = plan(ARM, TARGET, PAPER, high)
    assert found.certificate.passed
    assert not found.tensions[0].any()


def test_no_maximum_is_a_maximum_that_never_holds() -> None:
    assert plan(ARM, TARGET, PAPER).effort == pytest.approx(plan(ARM, TARGET, PAPER, 20.0).effort)


@pytest.mark.quick("1e+308")
@pytest.mark.parametrize("most", [1e308, [np.inf] * 12, [[20.0, np.inf, 1e9, 1e25]] * 3])
def test_maxima_of_any_size_that_never_hold_do_not_matter(most: Any) -> None:
    free = plan(ARM, TARGET, PAPER, 20.0)
    assert plan(ARM, TARGET, PAPER, most).effort == pytest.approx(free.effort)


@pytest.mark.parametrize("most", [1e-9, 1e-100, 5e-324])
def test_maxima_that_do_nothing_hold_everything_back(most: float) -> None:
    found = plan(ARM, TARGET, PAPER, most)
    assert not found.reached and found.tensions.max() <= most
    assert "at its maximum" in found.outcome


def test_what_holds_everything_back_at_zero_is_said() -> None:
    found = plan(ARM, TARGET, PAPER, 0.0)
    assert not found.reached
    assert not found.tensions.any()
    assert found.outcome.startswith("Not reached")


def test_starts_are_counted_and_their_agreement_too() -> None:
    found = plan(ARM, TARGET, PAPER, 20.0)
    assert 1 <= found.agreed <= len(found.starts) <= 8
    for count in (1, 8, 11):
        assert len(plan(ARM, TARGET, PAPER, 20.0, starts=count).starts) == count
