"""Derivatives of programs in the tensions, against differences of shapes settled anew."""

import numpy as np
import pytest

from model import Scene, settle
from model.effects import Contact, ExactTendons, Extension
from model.obstacles import Capsule
from planner.contact.equilibria import FINE, Equilibria
from planner.contact.program import TensionProgram
from planner.program.limits import Limits
from planner.program.statement import Statement
from planner.solve.task import Task
from planner.targets import Hold, TipPosition
from tests.contact.cases import bar

ARM = bar(0.3, 0.006, 2e5)
ROD = Capsule((0.2, -0.1, -0.04), (0.2, 0.1, -0.04), 0.02)
SCENE = Scene(Extension(), ExactTendons(), Contact(ROD))
T = np.array([0.05, 0.6, 0.0, 0.02])


@pytest.mark.quick("some")
@pytest.mark.parametrize("columns", [slice(1, None, 3), slice(None)], ids=["some", "all"])
def test_derivatives_of_targets_grip_and_stability_are_those_of_settled_shapes(
    columns: slice,
) -> None:
    tip = tuple(settle(ARM, T, SCENE).tip.tolist())
    targets = (TipPosition(tip), Hold(ROD, (0.01, 0.0, -0.05, 0.0, 1e-4, 0.0), 0.5))
    limits = Limits((0.0,) * 4, (5.0,) * 4, 9.0)
    task = Task(ARM, targets, SCENE, limits, Statement(limited=True), 1e-6)
    equilibria = Equilibria(task, FINE)
    begin = equilibria.settled(T)
    program = TensionProgram(task, equilibria.near(begin), begin, least=0.1)
    y = program.start
    assert y.size > ARM.n_tendons
    y[ARM.n_tendons :] += 0.1
    rows, h = program.rows(y), 1e-4
    differences = [
        (program.rows(y + step).values - program.rows(y - step).values) / (2 * h)
        for step in h * np.eye(y.size)[columns]
    ]
    assert rows.jacobian[:, columns] == pytest.approx(np.array(differences).T, rel=1e-3, abs=2e-5)
    assert np.abs(rows.jacobian).max(axis=1).min() > 1e-3
