"""Loads that are too heavy bend an arm over, or raise an error; no call hangs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipkinc, ellipkm1

from octoplan.model import (
    Arm,
    InputError,
    OctoplanError,
    Scene,
    settle,
)
from octoplan.model.effects import Current, Extension, TipLoad, Weight
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.friction import Friction
from octoplan.planner import Plan, plan
from octoplan.planner.targets import TipPosition
from tests.collocation import collocated
from tests.core.effects.bars import NO_PULL, Bar

ARM = Arm.from_paper("table-4")
ONE_SECTION = Arm.from_paper("section-5.2")
TIP = TipPosition((0.2, 0.05, 0.0))
BAR = Bar()
EULER = np.pi**2 * BAR.EJ(0.0) / (4 * BAR.length**2)
MULTIPLES = [0.5, 2.0, 4.0, 8.5, 9.5, 16.0, 24.0, 26.0, 60.0, 200.0]


def bent_over(force: float, way: float) -> float:
    """Return the angle of the tip of a bar without inflection under a force at `way` from its axis.

    With a the angle between tip and force and q = cos(a / 2), L (F / EJ)^(1/2) = K(q) - F(f, q),
    sin f = cos(way / 2) / q: a pendulum that swings from the clamp to the turning point.
    """
    wanted = BAR.length * np.sqrt(force / BAR.EJ(0.0))

    def short(p: float) -> float:  # p = 1 - q^2, which falls to some exp(-2 wanted)
        at = np.arcsin(min(1.0, np.cos(way / 2) / np.sqrt(1 - p)))
        return float(ellipkm1(p) - ellipkinc(at, 1 - p)) - wanted

    p = brentq(short, 1e-15, 1 - np.cos(way / 2) ** 2, xtol=1e-17)
    return way - 2 * float(np.arcsin(np.sqrt(p)))


@pytest.mark.parametrize("times", MULTIPLES[:-1])
def test_a_push_a_little_aside_bends_a_bar_over_however_hard_it_is(times: float) -> None:
    way = np.radians(176.0)
    force = times * EULER * np.array([np.cos(way), np.sin(way), 0.0])
    shape = settle(BAR.arm, NO_PULL, Scene(TipLoad(tuple(force))), 1e-8)
    angle = np.arctan2(*shape.tip_frame[[1, 0], 0])
    assert angle == pytest.approx(bent_over(float(np.linalg.norm(force)), way), abs=1e-6)
    assert shape.strain(np.linspace(0, BAR.length, 50)[:-1])[:, 2].max() < 1e-6


TOO_MUCH: dict[str, tuple[Effect, ...]] = {
    "a payload of 10 kg": (TipLoad((0.0, 0.0, -100.0)),),
    "a moment of 1 Nm": (TipLoad(moment=(0.0, 0.0, 1.0)),),
    "a follower of 100 N": (TipLoad((0.0, 100.0, 0.0), follower=True),),
    "a stream of 10 m/s": (Current((0.0, 0.0, -10.0)),),
    "rough sheaths": (Friction(1e6),),
    "a force out of this world": (TipLoad((0.0, 1e25, 0.0)),),
    "weight out of this world": (Weight((0.0, 0.0, -1e20)),),
    "a stream faster than light": (Current((0.0, 0.0, 1e20)),),
}


@pytest.mark.slow
@pytest.mark.parametrize("effects", TOO_MUCH.values(), ids=TOO_MUCH)
def test_absurd_loads_are_settled_alike_by_two_stages_or_told(effects: tuple[Effect, ...]) -> None:
    scene, T = Scene(Extension(), *effects), [0.3, 0.2, 0.0, 0.1]
    try:
        tip = settle(ONE_SECTION, T, scene, 1e-4).tip
    except OctoplanError:
        return
    finer = collocated(ONE_SECTION, T, scene, 2, 64).tip
    assert np.linalg.norm(tip - finer) < 1e-4 * ONE_SECTION.length


FOLDS: dict[str, tuple[float, float, float]] = {
    "a push of 1 N": (-1.0, 0.0, 0.0),
    "a payload of 0.1 kg": (0.0, 0.0, -1.0),
}


@pytest.mark.quick("a payload of 0.1 kg-1")
@pytest.mark.parametrize("seconds", [1, None])
@pytest.mark.parametrize("force", FOLDS.values(), ids=FOLDS)
def test_a_plan_under_a_payload_that_folds_the_arm_is_an_outcome_or_an_error_of_ours(
    force: tuple[float, float, float], seconds: float | None
) -> None:
    check_outcome(ONE_SECTION, force, seconds)


@pytest.mark.slow
def test_a_plan_of_three_sections_under_a_payload_that_folds_them_comes_to_an_end() -> None:
    check_outcome(ARM, (0.0, 0.0, -1.0), None)


def check_outcome(arm: Arm, force: tuple[float, float, float], seconds: float | None) -> None:
    """Plan under a payload; the outcome or the error must describe the result."""
    try:
        found = plan(arm, TIP, Scene(Extension(), TipLoad(force)), 20.0, time_limit=seconds)
    except OctoplanError as reason:
        assert not isinstance(reason, InputError)
        assert str(reason)
        return
    assert isinstance(found, Plan)
    certain = found.certificate.passed
    outcome = found.outcome.removeprefix("Stopped at the time limit, the best so far. ")
    assert outcome.startswith("Reached" if certain else ("Not reached", "Not certified"))
    assert found.certificate.bounds == 0
