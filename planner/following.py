"""What answers a question: the plan that one nearby leads to, or the best from all starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from model.time_limit import time_limit
from planner.answer import Answer
from planner.avoidance.around import Around
from planner.avoidance.asked import Surroundings
from planner.avoidance.clear import keeping, line_of
from planner.avoidance.rows import Avoidance
from planner.solve.search import Search
from planner.solve.search_result import SearchResult
from planner.solve.task import Task
from planner.solve.warm_start import jump, warm_start


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
        followed = warm_start(near, near.targets, task)
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
    found = warm_start(near, near.stated, keeping(task, near.avoidance))
    if found is None or found.stopped or found.jump:
        return None
    line = line_of(task, found.statement, np.ravel(found.tensions), finished=True)
    return found if line is not None and around.keeps(line) else None
