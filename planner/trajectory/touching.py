"""Motions of an arm that leans on things: each target planned from the one before, on its way.

Which of several equilibria an arm is in depends on how it came there, so that waypoints are planned
one after another, each for the least effort to which tensions lead from the one before, and shapes
are settled along the motion, each near the last. A plan that is come to by further tensions has
these as waypoints. Friction acts against the way from the waypoint before, which is straight in the
tensions.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from model.errors import InputError
from model.mesh import FINEST_ACCURACY
from model.paths import Array
from model.progress import reported, tell
from model.shape import Shape
from planner.contact.load_path import from_rest, is_same, rubs, settled_along
from planner.plan import HeldPlan
from planner.trajectory.question import Question


def check_touching(question: Question) -> None:
    """Raise InputError for what is not stated of motions in contact."""
    rates = question.rates
    if question.surroundings:
        raise InputError(
            "obstacles", "given", "none in a scene with contact: there they are effects"
        )
    if rates.of_strokes or rates.at_rest:
        name = "stroke_rate_max" if rates.of_strokes else "tip_acceleration_max"
        raise InputError(name, "given", "rate_max or times in a scene with contact")
    if rubs(question.scene) and _begin(question) is None:
        if not np.array_equal(question.start, question.limits.lower):
            allowed = "with friction of contacts the plan that the arm moves from, or none"
            raise InputError("start", question.start.tolist(), allowed)
        from_rest(question.arm, question.start, question.scene, "start")


def planned_touching(question: Question) -> tuple[Array, tuple[int, ...]]:
    """Return the tensions (N + 1, n_tendons) at the waypoints, and at which targets are met.

    Waypoints are the targets, and what plans for these are come to by.
    """
    tensions, met, near = [question.start], list[int](), _begin(question)
    for k in range(len(question.targets)):
        tell("waypoints", k, len(question.targets))
        planned = _planned(question, k, near)
        before = () if near is None else (*near.load_path, tuple(np.ravel(near.tensions).tolist()))
        follows = planned.load_path[: len(before)] == before
        tensions += [np.array(T) for T in planned.load_path[len(before) * follows :]]
        tensions.append(np.ravel(planned.tensions))
        met.append(len(tensions) - 1)
        near = planned
    return np.vstack(tensions), tuple(met)


def _begin(question: Question) -> HeldPlan | None:
    """Return the plan in this scene that the motion begins with, if any is given."""
    begin = question.begin
    if isinstance(begin, HeldPlan) and is_same(begin.scene, question.scene):
        return begin
    return None


def _planned(question: Question, k: int, near: HeldPlan | None) -> HeldPlan:
    """Return the plan that is come to from the one before; from any start where that misses."""
    plan = None
    if near is not None:
        with suppress(InputError):
            plan = question.planned(k, near, 1)
    plan = plan or question.planned(k, near)
    assert isinstance(plan, HeldPlan)
    return plan


def shapes_along(question: Question, tensions: Array) -> tuple[Shape, ...]:
    """Return the shapes at tensions (N + 1, n_tendons), each near the one before.

    The first from rest, or on the load path of the plan that the motion begins with. `Shape.snaps`
    of each tells where the arm jumps before it.
    """
    fine, begin = max(question.accuracy / 10, FINEST_ACCURACY), question.begin
    path = begin.load_path if isinstance(begin, HeldPlan) else ()
    first = question.arm, path, tensions[0], question.scene, fine, question.machine_code
    shapes = [settled_along(*first)]
    for T in reported("shapes", list(tensions[1:])):
        shapes.append(question.shape(T, shapes[-1]))
    return tuple(shapes)
