"""What answers a question: the plan that one nearby leads to, or the best from all starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.time_limit import OutOfTime, time_limit
from planner.answer import Answer
from planner.avoidance.around import Around
from planner.avoidance.asked import Surroundings
from planner.avoidance.clear import keeping, line_of
from planner.avoidance.rows import Avoidance
from planner.solve.search import Search
from planner.solve.search_result import SearchResult
from planner.solve.task import Task
from planner.solve.warm_start import Optimum, jump, warm_start
from planner.targets.base import Target


def searched(
    task: Task, around: Surroundings, near: Answer | None, seconds: float | None
) -> tuple[SearchResult, Avoidance | None]:
    """Return what a plan that is near leads to, or the best from all starts."""
    if near is None:
        if around:
            return Around(task, around).run(seconds)
        return Search(task).run(seconds), None
    with time_limit(seconds):
        kept = _kept_clear(near, task, around)
        if kept is not None:
            return kept, near.avoidance
        followed = _followed(near, task, near.targets)
        avoidance, left = None, not followed
        if around and not (followed and followed.stopped):
            led = Around(task, around)
            found, avoidance = led.run(seconds, followed)
            left = led.searched
        else:
            found = followed or Search(task).run()
    if not left or found.stopped or found.statement.mode != "exact":
        return found, avoidance
    return replace(found, jump=jump(near.tensions, found.tensions)), avoidance


def _kept_clear(near: Answer, task: Task, around: Surroundings) -> SearchResult | None:
    """Return what a plan among the same obstacles leads to by the inequalities of its program.

    None where that does not keep clear, or leaves its branch.
    """
    if near.avoidance is None or near.surroundings != around:
        return None
    found = _followed(near, keeping(task, near.avoidance), near.stated)
    if found is None or found.stopped or found.jump:
        return None
    line = line_of(task, found.statement, np.ravel(found.tensions), finished=True)
    return found if line is not None and around.keeps(line) else None


def _followed(near: Answer, task: Task, stated: tuple[Target, ...]) -> SearchResult | None:
    """Return what a plan for `stated` targets leads to, None where it cannot be followed."""
    limits, own = task.limits, near.limits
    same = near.statement.margin == task.statement.margin
    if not same or replace(own, lower=limits.lower) != limits:
        return None
    answer = (near.tensions, near.lam_x, near.lam_g, near.known_equilibrium)
    statement = near.statement
    if task.accuracy > near.accuracy:
        statement = statement.but(refinement=task.coarse(statement.mode).refinement)
    try:
        return warm_start(Optimum(stated, own.lower, statement, *answer), task)
    except OutOfTime:
        T = np.clip(np.ravel(near.tensions), limits.lower, limits.upper)
        return SearchResult(near.statement, task.arm.by_section(T), (), (), (), stopped=True)
