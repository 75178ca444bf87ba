"""What a study found at full size holds."""

from __future__ import annotations

import pytest

from tests.commands import study


@pytest.mark.slow
def test_two_hundred_random_tips_are_certified_and_none_wrongly() -> None:
    shown = study("planner_suite", "--kinds", "tip", "--targets", "200", "--best-of", "0")
    (total,) = (line.split() for line in shown.splitlines() if line.startswith("all"))
    assert total[1:4:2] == ["200", "0"]
    assert float(total[2].rstrip("%")) >= 99
