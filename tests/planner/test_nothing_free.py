"""Where all is held by bounds there is no Newton step, and LAPACK prints nothing of it."""

from __future__ import annotations

import numpy as np
import pytest

from planner.solve import newton


def test_an_empty_step_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    assert newton._newton(np.zeros((0, 0)), np.zeros(0)).size == 0
    assert capfd.readouterr() == ("", "")
