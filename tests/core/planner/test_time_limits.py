"""A time limit holds for the whole answer: reading a plan afterwards computes nothing."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, InputError, Scene, settle
from octoplan.model.effects import Buoyancy, ExactTendons, Extension, Weight
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.obstacles import Capsule, Sphere
from octoplan.model.support.errors import UncertifiedError
from octoplan.model.support.progress import (
    GRACE,
    OUT_OF_TIME,
    check_time,
    reserve,
    seconds_left,
    time_limit,
)
from octoplan.planner import Plan, load_plan, plan
from octoplan.planner.extensions.contact import Wrap
from octoplan.planner.extensions.fit.calibrate import calibrate
from octoplan.planner.extensions.fit.measured import Measured
from octoplan.planner.extensions.fit.unknowns import Unknown
from octoplan.planner.extensions.trajectory.motion import trajectory
from octoplan.planner.targets import BendingPlane, TipPosition
from tests.contact.cases import bar

ARM = Arm.from_paper("table-4")
PAPER = Scene(Extension())
WATER = Scene(Extension(), Weight(), Buoyancy(1000.0))
TIP = TipPosition((0.2, 0.1, 0.1))
BALL = Sphere((0.3, 0.0, -0.1), 0.02)
ASIDE = Sphere((0.3, -0.2, 0.2), 0.02)
ROD = Capsule((0.2, -0.1, -0.04), (0.2, 0.1, -0.04), 0.02)
BAR = bar(0.3, 0.006, 2e5)
LEANING = Scene(Extension(), ExactTendons(), Contact(ROD))


def leaning(**options: Any) -> Plan:
    """Return a plan of a bar that leans on the rod."""
    tip = settle(BAR, [0.0, 0.6, 0.0, 0.0], LEANING).tip
    return plan(
        BAR,
        TipPosition(tuple(tip.tolist())),
        LEANING,
        50.0,
        starts=1,
        **options,
    )


def in_plane(**options: Any) -> Plan:
    """Return a plan out of the plane of its target; the mirror image meets the target too."""
    rng, T = np.random.default_rng(3), np.zeros((3, 4))
    pulls = rng.exponential(1, (3, 2)) * np.array([[0.2], [1.0], [3.0]])
    pulls *= rng.random((3, 2)) < 0.6
    T[:, [0, 1]], T[:, [2, 3]] = pulls[:, :1], pulls[:, 1:]
    return plan(ARM, TipPosition(tuple(settle(ARM, T, PAPER).tip)), PAPER, 20.0, **options)


PLANS: dict[str, Callable[..., Plan]] = {
    "paper": lambda **more: plan(ARM, TIP, PAPER, 20.0, **more),
    "loads": lambda **more: plan(ARM, TIP, WATER, 20.0, **more),
    "obstacle": lambda **more: plan(ARM, TIP, PAPER, 20.0, obstacles=[BALL], **more),
    "out of reach": lambda **more: plan(ARM, TipPosition((0.6, 0.0, 0.0)), PAPER, 1.0, **more),
    "mirror image": in_plane,
    "contact": leaning,
    "wrap": lambda **more: plan(BAR, Wrap(ROD, turns=0.1), LEANING, 50.0, starts=1, **more),
}


def reading(p: Plan) -> tuple[Any, ...]:
    """Return the values that users read from a plan."""
    certificate = p.certificate
    numbers = certificate.clearance, certificate.stability, certificate.load_factor
    return p.reached, p.outcome, str(p), repr(certificate), numbers, certificate.warnings


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Advance the clock by a second at each call, and return the clock."""
    looks = count(1)
    now = SimpleNamespace(seconds=0)

    def monotonic() -> float:
        now.seconds = next(looks)
        return float(now.seconds)

    slow = SimpleNamespace(monotonic=monotonic, process_time=lambda: 0.0)
    monkeypatch.setattr("octoplan.model.support.progress.time", slow)
    monkeypatch.setattr("octoplan.planner.extensions.contact.search.time", slow)
    return now


def endless(*_: object, **__: object) -> Any:
    """Compute until the time limit."""
    while True:
        check_time()


@pytest.mark.quick("paper", "mirror image", "contact")
@pytest.mark.parametrize("name", PLANS)
def test_reading_a_plan_computes_nothing(name: str) -> None:
    p = PLANS[name]()
    with time_limit(1e-9):
        inside = reading(p)
        assert p.shape.tip is not None
    assert inside == reading(p)
    assert OUT_OF_TIME not in p.outcome
    assert ("mirror image" in p.outcome) == (name == "mirror image")
    anew = reading(replace(p))
    assert inside[:4] == anew[:4]


@pytest.mark.quick("paper-100")
@pytest.mark.parametrize("seconds", [1, 10, 30, 100, 300, 1000])
@pytest.mark.parametrize("name", ["paper", "loads", "obstacle", "contact"])
def test_a_limit_holds_until_all_is_read(name: str, seconds: int, clock: SimpleNamespace) -> None:
    """The certificate was computed at the first access, without a limit."""
    begun = clock.seconds
    p = PLANS[name](time_limit=seconds)
    # Each nested limit reads the clock once more at its end.
    assert clock.seconds - begun <= seconds + GRACE + 20
    if not p.reached:
        assert "time limit" in p.outcome
    with time_limit(1e-9):
        inside = reading(p)
    assert inside == reading(p)


@pytest.mark.parametrize(
    "what", ["planner.certificate._integrated", "planner.extensions.avoidance.checks.clearances"]
)
def test_a_slow_certificate_is_told_as_not_certified(
    what: str, monkeypatch: pytest.MonkeyPatch, clock: SimpleNamespace
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(f"octoplan.{what}", endless)
        p = plan(ARM, TIP, PAPER, 20.0, time_limit=1e4)
    assert clock.seconds <= 1e4 + GRACE + 20
    assert not p.solution.stopped and not p.reached
    assert p.certificate.problem == OUT_OF_TIME
    assert p.outcome.startswith("Not certified: the time limit was reached")
    assert "certificate: FAILED" in str(p)
    again = p.certify()
    assert again == p
    assert again.reached, again.outcome


def test_a_slow_load_factor_is_left_out(
    monkeypatch: pytest.MonkeyPatch, clock: SimpleNamespace
) -> None:
    monkeypatch.setattr("octoplan.planner.certificate._load_factor", endless)
    p = plan(ARM, TIP, WATER, 20.0, time_limit=1e4)
    assert p.reached
    assert p.certificate.load_factor is None
    assert "times its loads" not in p.outcome + str(p)


def test_a_shape_that_is_not_settled_in_time_is_an_error(
    monkeypatch: pytest.MonkeyPatch, clock: SimpleNamespace, tmp_path: Path
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr(Plan, "_settle", endless)
        p = plan(ARM, TIP, PAPER, 20.0, time_limit=1e4)
    for each in (p, pickle.loads(pickle.dumps(p))):
        with pytest.raises(UncertifiedError, match="time limit"):
            each.shape  # noqa: B018  (raises)
        assert OUT_OF_TIME in each.outcome
        assert "tensions [N]" in str(each)
    loaded = load_plan(p.save(tmp_path / "plan.json"))
    assert loaded == p
    assert loaded.reached


def test_a_loaded_plan_is_certified_within_its_limit(
    monkeypatch: pytest.MonkeyPatch, clock: SimpleNamespace, tmp_path: Path
) -> None:
    path = PLANS["paper"]().save(tmp_path / "plan.json")
    monkeypatch.setattr("octoplan.planner.certificate._integrated", endless)
    p = load_plan(path, time_limit=100)
    assert clock.seconds <= 120
    assert p.certificate.problem == OUT_OF_TIME
    with pytest.raises(InputError, match="time_limit"):
        load_plan(path, time_limit=0)
    with pytest.raises(InputError, match="time_limit"):
        p.certify(time_limit=-1)


def test_a_plan_in_contact_leaves_time_for_its_certificate(
    monkeypatch: pytest.MonkeyPatch, clock: SimpleNamespace
) -> None:
    """The search took all of the limit, and the certificate the same time again."""
    left = list[float]()
    complete = Plan.complete

    def looked(self: Plan) -> None:
        left.append(seconds_left())
        complete(self)

    monkeypatch.setattr(Plan, "complete", looked)
    monkeypatch.setattr("octoplan.planner.extensions.contact.search.optimum", endless)
    leaning(time_limit=1000)
    assert left[0] >= 200


def test_time_is_reserved_of_the_innermost_limit_only() -> None:
    with time_limit(100.0, reserves=True):
        reserve(40.0)
        assert seconds_left() == pytest.approx(60.0, abs=1.0)
        with time_limit(None):
            reserve(50.0)
            assert seconds_left() == pytest.approx(60.0, abs=1.0)
        reserve(10.0)
        assert seconds_left() == pytest.approx(90.0, abs=1.0)
    assert seconds_left() == np.inf


def test_plans_without_certificates_have_none_until_read(monkeypatch: pytest.MonkeyPatch) -> None:
    certified = list[object]()
    certify = Plan.complete
    monkeypatch.setattr(Plan, "complete", lambda self: certified.append(self) or certify(self))
    p = plan(ARM, TIP, PAPER, 20.0, certify=False)
    assert not certified
    assert p.reached
    targets = [TipPosition((0.2, 0.1 + 0.01 * k, 0.1)) for k in range(3)]
    motion = trajectory(ARM, targets, PAPER, 20.0, rate_max=1.0)
    assert motion.reached == (True, True, True)
    assert not certified
    with pytest.raises(InputError, match="certify"):
        plan(ARM, TIP, PAPER, 20.0, certify=1)  # type: ignore[arg-type]


TARGETS = [TipPosition((0.2, 0.1, 0.1)), TipPosition((0.2, 0.12, 0.1))]


@pytest.mark.slow
def test_reading_a_motion_computes_nothing() -> None:
    motion = trajectory(ARM, TARGETS, WATER, 20.0, rate_max=1.0, obstacles=[ASIDE])
    with time_limit(1e-9):
        inside = motion.reached, motion.outcome, str(motion), motion.lengths.tolist()
    assert inside == (motion.reached, motion.outcome, str(motion), motion.lengths.tolist())
    assert "times gravity" in motion.outcome


@pytest.mark.parametrize("what", ["certify", "between"])
def test_a_slow_certificate_of_a_motion_is_told(
    what: str, monkeypatch: pytest.MonkeyPatch, clock: SimpleNamespace
) -> None:
    """Targets that were not verified counted as reached: all(()) is True."""
    monkeypatch.setattr(
        import_module("octoplan.planner.extensions.trajectory.certificate"), what, endless
    )
    motion = trajectory(ARM, TARGETS, PAPER, 20.0, rate_max=1.0, time_limit=1e5)
    assert clock.seconds <= 1e5 + GRACE + 20
    assert motion.reached == (False, False)
    assert motion.outcome.startswith("Not certified")
    assert OUT_OF_TIME in motion.outcome
    with time_limit(1e-9):
        assert "Not certified" in str(motion)


def test_a_slow_estimate_of_a_motions_pace_is_left_out(
    monkeypatch: pytest.MonkeyPatch, clock: SimpleNamespace
) -> None:
    result = import_module("octoplan.planner.extensions.trajectory.result")
    monkeypatch.setattr(result, "slowest_period", endless)
    motion = trajectory(ARM, TARGETS, PAPER, 20.0, rate_max=1.0, time_limit=1e5)
    assert motion.reached == (True, True)
    assert motion.outcome.startswith("Reached")
    assert "gravity" not in motion.outcome


def test_a_calibrated_plan_is_certified_once(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = Arm.from_paper("table-2")
    T = np.full(arm.n_tendons, 0.0)
    T[0] = 1.0
    tip = tuple(settle(arm, T, PAPER).tip.tolist())
    found = calibrate(arm, PAPER, [Measured(tensions=T, tip=tip)], [Unknown("arm.E_kPa", 1, 1e6)])
    p = found.plan(BendingPlane(0.5, 0.5), tension_max=20.0)
    with time_limit(1e-9):
        assert p.reached
        assert "By the calibration" in p.outcome
        assert OUT_OF_TIME not in p.outcome
