"""Functions of many columns: each has the digits of CasADi's interpreter, whatever takes it."""

from __future__ import annotations

import shutil
from typing import Any

import casadi as ca
import numpy as np
import pytest

from model import Arm, Scene
from model.effects import ExactTendons, Extension, PrintedStatics
from model.forward import explicit_map
from model.machine.buffered import Mapped
from model.machine.columns import unknown
from tests.model.cases import paper_tensions

ARM = Arm.from_paper("table-4")
SCENES = {
    "paper": (Scene(Extension()), "magnus6"),
    "exact": (Scene(Extension(), ExactTendons()), "magnus4"),
    "printed": (Scene(PrintedStatics()), "rk4"),
}
BY = [
    False,
    pytest.param(True, marks=pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler")),
]


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("machine_code", BY)
def test_many_arms_are_those_one_by_one(scene: str, machine_code: bool) -> None:
    sets = [paper_tensions(np.random.default_rng(i), "table-4") for i in range(130)]
    forward = explicit_map(ARM, *SCENES[scene], 2, (), machine_code)
    T, nodes = 0.1 * np.array(sets), [0, 3, 3, forward.mesh.steps]
    poses, least = forward.many(T, nodes)
    for i in range(0, 130, 13):
        states, stretch, _ = forward.run(T[i])
        assert np.allclose(poses[i], states[nodes, :7], rtol=0, atol=1e-14)
        assert np.isclose(least[i], stretch.min(), rtol=0, atol=1e-14)


def test_an_operation_that_is_not_in_the_table_is_left_to_casadi() -> None:
    x = ca.SX.sym("x", 2)
    f = ca.Function("f", [x], [ca.erf(x[0]) + x[1]])
    assert unknown(f) == [ca.OP_ERF]
    points = np.random.default_rng(0).uniform(size=(200, 2))
    (found,) = Mapped(f)(points)
    assert np.array_equal(found[:, 0], np.array(f(points.T)).ravel())


@pytest.mark.parametrize("machine_code", BY)
def test_no_arms_have_no_poses(machine_code: bool) -> None:
    forward: Any = explicit_map(ARM, Scene.silicone(), "magnus6", 1, (), machine_code)
    poses, least = forward.many(np.zeros((0, 12)), [0, 3])
    assert poses.shape == (0, 2, 7)
    assert least.shape == (0,)
    assert forward.strains_of_many(np.zeros((0, 12))).shape == (0, forward.data.shape[0], 3)
