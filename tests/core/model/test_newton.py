"""Steps of Newton's method that diverge."""

from __future__ import annotations

import numpy as np
import pytest

from octoplan.model import Arm, Scene
from octoplan.model.effects import Extension, TipLoad
from octoplan.model.equilibrium.newton import Start, _Iteration
from octoplan.model.forward import ForwardMaps


@pytest.mark.parametrize("size", [1e3, 1e160, 1e300])
def test_a_step_of_any_size_is_not_converged(size: float) -> None:
    arm = Arm.from_paper("table-4")
    T = np.full(arm.n_tendons, 0.1)
    forward = ForwardMaps(arm, Scene(Extension(), TipLoad((0.0, 0.0, -1e-3))), False).on(1)
    point = forward.solve(T)
    start = Start(T, 1.0, point.states)
    iteration = _Iteration(start, point.x.copy(), None, np.inf, is_nonsmooth=True)
    iteration.take(point, np.zeros(point.states.size), 0.0, size)
    assert iteration.result is None
    assert iteration.last_size == size
