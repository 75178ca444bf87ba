"""Refusals of contact, friction, holds and wraps."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import ExactTendons, Extension, Weight
from octoplan.model.extensions.contact.effects import Contact, SelfContact
from octoplan.model.extensions.friction import Friction
from octoplan.model.extensions.obstacles import Capsule, HalfSpace, Sphere
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.stiffness import stiffness
from octoplan.planner import plan, trajectory
from octoplan.planner.extensions.contact import Hold, Wrap
from octoplan.planner.targets import TipPosition
from tests.contact.cases import bar
from tests.refusals import Refused, check_refusal

ARM, PAPER = bar(0.3, 0.006, 2e5), Arm.from_paper("table-4")
BENT = np.array([[0, 0, 0.5, 0], [4, 0, 0, 0], [0, 3, 0, 0]])
ROD = Capsule((0.1, -0.05, -0.06), (0.1, 0.05, -0.06), 0.02)
BALL, FLOOR = Sphere((0.2, 0.1, 0.1), 0.02), HalfSpace((0, 0, -0.03), (0, 0, 1))
FAR = Sphere((0.4, 0.0, 0.0), 0.02)
CEILING, NARROW = HalfSpace((0, 0, 0.01), (0, 0, -1)), HalfSpace((0, 0, -0.01), (0, 0, 1))
SMOOTH, ROUGH = (
    Scene(Extension(), ExactTendons(), Weight(), Contact(FLOOR, mu)) for mu in (0.0, 0.3)
)
WEIGHTLESS = Scene(Extension(), ExactTendons())
RUBBING = WEIGHTLESS + Contact(ROD, friction=0.3)
ITSELF, TIP = Scene(SelfContact()), TipPosition((0.25, 0.05, 0.0))
STIFF, LOW = bar(0.3, 0.006, 2e7), TipPosition((0.29, 0.0, -0.024))


def motion(scene: Scene, **asked: Any) -> Callable[[], object]:
    return partial(trajectory, STIFF, [LOW], scene, 30.0, **asked)


def held(wrench: tuple[float, ...], friction: float = 0.1) -> Callable[[], object]:
    return partial(Hold, ROD, wrench, friction)


def wrapped(scene: Scene | None = None, **part: Any) -> Callable[[], object]:
    return lambda: plan(ARM, Wrap(ROD, **part), scene or Scene(), 50.0)


CONTACTS: Refused = {
    "an arm that begins inside": (
        partial(settle, PAPER, BENT, Scene(Contact(Sphere((0.2, 0, 0.02), 0.03)))),
        "Contact.obstacle",
        "19.2 mm inside at s = 0.2",
    ),
    "a plan that begins inside": (
        partial(plan, ARM, TIP, Scene(Contact(Sphere((0.15, 0, 0), 0.02))), 30.0),
        "",
        "inside at s",
    ),
    "nothing fits between": (
        partial(settle, PAPER, BENT, Scene(Contact(CEILING), Contact(NARROW))),
        "Contact.obstacle",
        "mm inside of HalfSpace",
    ),
    "no obstacle": (partial(Contact, 0.1), "Contact.obstacle", ""),
    "friction below 0": (partial(Contact, ROD, friction=-0.1), "Contact.friction", ""),
    "a body twice": (partial(Scene, Contact(ROD), Contact(ROD)), "", "a body once"),
    "as printed": (
        partial(Scene, Extension(), PrintedStatics(), Contact(ROD)),
        "",
        "PrintedStatics",
    ),
    "rubs by lengths": (
        lambda: settle(PAPER, lengths=np.full(12, 0.4), scene=RUBBING),
        "",
        "lengths",
    ),
    "rubs without history": (partial(settle, PAPER, BENT, RUBBING), "", "history"),
}
PLANS: Refused = {
    "largest tension": (
        partial(plan, ARM, TIP, SMOOTH, 30.0, norm="inf"),
        "norm",
        "",
    ),
    "obstacles": (partial(plan, ARM, TIP, SMOOTH, 30.0, obstacles=[BALL]), "obstacles", ""),
    "motion": (motion(SMOOTH, rate_max=2.0, obstacles=[BALL]), "obstacles", ""),
    "strokes": (motion(SMOOTH, stroke_rate_max=0.01), "stroke_rate_max", ""),
    "no history": (partial(plan, STIFF, LOW, ROUGH, 30.0), "", "history"),
    "motion without history": (motion(ROUGH, rate_max=2.0), "", "history"),
    "motion from tensions": (motion(ROUGH, rate_max=2.0, start=[1.0, 0, 0, 0.5]), "start", ""),
    "no time": (motion(Scene(Extension()), rate_max=2.0, time_limit=0), "time_limit", ""),
}
ON_ITSELF: Refused = {
    "plan": (partial(plan, ARM, TIP, ITSELF, 5.0), "", "SelfContact"),
    "stiffness": (partial(stiffness, ARM, [0, 1.0, 0, 0], ITSELF), "", "SelfContact"),
    "lengths": (lambda: settle(ARM, lengths=np.full(4, 0.29), scene=ITSELF), "", "SelfContact"),
    "contact": (partial(Scene, Extension(), SelfContact(), Contact(BALL)), "", "SelfContact"),
    "friction": (partial(Scene, Extension(), SelfContact(), Friction(0.1)), "", "SelfContact"),
}
HOLDS: Refused = {
    "friction below 0": (held((0, 0, 0.1), -0.1), "Hold.friction", ""),
    "no force": (held((0, 0, 0)), "Hold.wrench", ""),
    "two numbers": (held((0, 1)), "Hold.wrench", ""),
    "no number": (held((0, 0, np.nan)), "Hold.wrench", ""),
    "another body": (partial(plan, ARM, Hold(BALL, (0, 0, 0.1)), SMOOTH, 50.0), "", "Contact"),
    "an object out of reach": (
        partial(plan, ARM, Hold(FAR, (0, 0, 0.1)), WEIGHTLESS + Contact(FAR), 50.0),
        "Hold.obstacle",
        "an obstacle within reach: it is 380 mm from the base, and the arm is 300 mm long",
    ),
    "no contact": (partial(plan, ARM, Hold(ROD, (0, 0, 0.1)), Scene(), 50.0), "", "Contact"),
}
WRAPS: Refused = {
    "both": (wrapped(turns=1.0, length=0.1), "", "both"),
    "neither": (wrapped(), "", "neither"),
    "negative turns": (wrapped(turns=-1.0), "Wrap.turns", ""),
    "no length": (wrapped(length=0.0), "Wrap.length", ""),
    "tolerance": (wrapped(length=0.1, tolerance=0.0), "Wrap.tolerance", ""),
    "longer than the arm": (wrapped(length=0.4), "", "0.3 m long"),
    "more turns than the arm has": (wrapped(turns=3.0), "Wrap.turns", ""),
    "beyond the tip": (wrapped(turns=0.2, start=0.3), "Wrap.start", ""),
    "a plane": (partial(Wrap, FLOOR, turns=1.0), "", "round a plane"),
    "out of reach": (
        partial(plan, ARM, Wrap(Sphere((0.5, 0, 0), 0.05), length=0.1), Scene(), 50.0),
        "",
        "within reach",
    ),
    "friction": (
        lambda: plan(PAPER, Wrap(ROD, length=0.1), RUBBING, 50.0),
        "Contact.friction",
        "= 0.3: must be 0 for holds and wraps",
    ),
    "another contact": (wrapped(SMOOTH, length=0.1), "", "Contact of the scene"),
}
TABLES = {"contact": CONTACTS, "plan": PLANS, "itself": ON_ITSELF, "hold": HOLDS, "wrap": WRAPS}
CASES = {f"{t}: {name}": row for t, table in TABLES.items() for name, row in table.items()}


@pytest.mark.parametrize(("attempt", "field", "told"), CASES.values(), ids=CASES)
def test_what_contact_does_not_state_is_refused_by_name(
    attempt: Callable[[], object], field: str, told: str
) -> None:
    check_refusal(attempt, field, told)
