"""Where all is held by bounds there is no Newton step, and LAPACK prints nothing of it."""

from __future__ import annotations

import numpy as np
import pytest

from planner.solve import newton


def test_an_empty_step_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    step, lam = newton._newton(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0), np.zeros(0))
    assert step.size == lam.size == 0
    assert capfd.readouterr() == ("", "")
