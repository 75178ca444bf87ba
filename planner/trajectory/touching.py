"""Motions of an arm that leans on things: each target planned from the one before, on its way.

Which of several equilibria an arm is in depends on how it came there, so that waypoints are planned
one after another, each for the least effort to which tensions lead from the one before, and shapes
are settled along the motion, each near the last. A plan that is come to by further tensions has
these as waypoints. Friction acts against the way from the waypoint before, which is straight in the
tensions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.errors import InputError
from model.progress import reported
from planner.contact.load_path import from_rest, rubs
from planner.plan import HeldPlan
from planner.trajectory.question import Question, Waypoint


def planned_touching(question: Question) -> list[Waypoint]:
    """Return the waypoints: the targets, and what plans for these are come to by.

    Raises InputError for what is not stated of motions in contact.
    """
    of_places = np.isfinite(question.rates.of_places)
    if question.surroundings:
        allowed = "none in a scene with contact: there they are effects"
        raise InputError("obstacles", "given", allowed)
    if of_places.any():
        name = "stroke_rate_max" if of_places[:2].any() else "tip_acceleration_max"
        raise InputError(name, "given", "rate_max or times in a scene with contact")
    if rubs(question.scene) and question.begin is None:
        if not np.array_equal(question.start, question.limits.lower):
            allowed = "with friction of contacts the plan that the arm moves from, or none"
            raise InputError("start", question.start.tolist(), allowed)
        from_rest(question.arm, question.start, question.scene, "start")
    near, waypoints = question.begin, list[Waypoint]()
    for k, targets in enumerate(reported("waypoints", list(question.targets))):
        before = () if near is None else (*near.load_path, tuple(np.ravel(near.tensions).tolist()))
        planned = question.planned(k, near)
        assert isinstance(planned, HeldPlan)
        follows, near = planned.load_path[: len(before)] == before, planned
        new = [*planned.load_path[len(before) * follows :], np.ravel(planned.tensions)]
        each = [Waypoint((), np.array(T), fraction=1 / len(new)) for T in new]
        waypoints += [*each[:-1], replace(each[-1], targets=targets)]
    return waypoints
