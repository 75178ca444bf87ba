"""What a certificate tells besides its verdict is found when it is asked for, and pickles."""

from __future__ import annotations

import pickle

from model.clearance import Clearance
from model.clearance.nearest import ITSELF
from planner.certificate import OnRequest


def test_each_is_found_when_it_is_asked_for_and_once() -> None:
    asked: list[str] = []

    def clearances() -> dict[str, Clearance]:
        asked.append("clearances")
        return {ITSELF: Clearance(0.01, ITSELF, (0.1, 0.2))}

    def load_factor() -> float:
        asked.append("load factor")
        return 2.0

    on_request = OnRequest(clearances, load_factor)
    assert asked == []
    assert [on_request.load_factor, on_request.load_factor] == [2.0, 2.0]
    assert asked == ["load factor"]
    assert on_request.clearances[ITSELF].gap == 0.01


def test_it_pickles_as_what_it_tells() -> None:
    on_request = OnRequest(lambda: {ITSELF: Clearance(0.01, ITSELF, (0.1, 0.2))}, lambda: 2.0)
    again = pickle.loads(pickle.dumps(on_request))
    assert again == on_request
    assert again != OnRequest()
