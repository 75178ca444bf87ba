"""Ill-posed plans: certified, or an outcome with the reason for the failure."""

from __future__ import annotations

import numpy as np

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import Extension
from octoplan.planner import plan
from octoplan.planner.limits import Limits
from octoplan.planner.targets import TipPosition
from tests.core.hard_cases.family import Array, Family, RefusedError, WrongAnswerError
from tests.oracles import paper_rod, poses

KINDS = ("redundant", "edge of reach", "straight", "few tendons", "all held")


def ill_posed(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Draw a tip to reach with the arm of table 4, maxima and minima of the tensions.

    Tips of settled shapes, shifted or not, and limits that leave little or nothing to choose.
    """
    kind, arm = str(rng.choice(KINDS)), Arm.from_paper("table-4")
    T = np.ravel(rng.uniform(0, 1, (3, 4)) * [[0.2], [1], [3]] * (rng.uniform(size=(3, 4)) < 0.5))
    most, least = np.full(12, 20.0), np.zeros(12)
    if kind == "redundant":
        T = np.repeat(rng.uniform(0, 0.2, 3), 4)
    if kind == "few tendons":
        most = 5.0 * (rng.uniform(size=12) < 0.25)
        T = np.minimum(T, most)
    if kind == "all held":
        most = least = T
    tip = settle(arm, T, Scene(Extension()), 1e-10).tip
    if kind == "edge of reach":
        tip = tip / np.linalg.norm(tip) * arm.length * rng.uniform(0.97, 1.1)
    if kind == "straight":
        tip = np.array([arm.length * (1 - rng.integers(2) * rng.uniform(0, 1e-3)), 0.0, 0.0])
    if kind == "few tendons" and rng.integers(2):
        tip = tip + rng.normal(size=3) * 0.02
    return tip, most, least


def check_ill_posed(tip: Array, most: Array, least: Array) -> float:
    """Return the distance of the oracle's tip under a certified plan from the target, over L."""
    arm = Arm.from_paper("table-4")
    target = TipPosition(tuple(tip.tolist()))
    found = plan(arm, target, Scene(Extension()), most, limits=Limits(tension_min=least))
    T = np.ravel(found.tensions)
    beyond = np.maximum(T - most, least - T)
    if beyond.max() > 1e-9:
        raise WrongAnswerError("tensions beyond their limits")
    if not found.certificate.passed:
        if not found.outcome.startswith("Not reached"):
            raise WrongAnswerError(found.outcome)
        raise RefusedError(found.outcome)
    rod = paper_rod("table-4")
    found_tip = poses(rod, T, [rod.length], True)[0][0]
    return float(np.linalg.norm(found_tip - tip)) / arm.length


ILL_POSED_PLANS = Family("ill-posed plans", 2e-6, ill_posed, check_ill_posed, refuses=True)
