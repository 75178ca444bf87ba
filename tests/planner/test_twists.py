"""Derivatives put together step by step along the arm are those of CasADi of the whole program."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from model import Anchorage, Arm, Linear, Scene, settle
from model.effects import Extension
from planner.program.explicit import Explicit
from planner.program.limits import Limits
from planner.program.problem import units
from planner.program.statement import Statement
from planner.program.terms import stations_of
from planner.targets import Backbone, Fetch, TipPose, TipPosition

TABLE_4 = Arm.from_paper("table-4")
SHORT = Arm(
    0.3,
    Linear(0.01, 0.004),
    (
        Anchorage(0.25, Linear(0.008, 0.004), (0.0, 2.0, 4.0)),
        Anchorage(0.1, Linear(0.008, 0.007), (1.0, 3.0)),
    ),
    base_frame=((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
)
BENT = {TABLE_4: np.array([0, 0, 0.2, 0, 0, 0.4, 0, 0, 0, 0, 1.0, 0]), SHORT: np.ones(5) / 3}


def targets(arm: Arm) -> dict[str, Any]:
    """Return targets that look at the tip, at its frame, at places along the arm, at sections."""
    shape = settle(arm, BENT[arm], Scene(Extension()))
    s = np.linspace(0.2, 1.0, 6) * arm.length
    tip, frame = tuple(shape.tip), tuple(map(tuple, shape.tip_frame))
    return {
        "tip": TipPosition(tip),
        "pose": TipPose(tip, frame),
        "backbone": Backbone(tuple(map(tuple, shape.position(s))), tuple(s)),
        "fetch": Fetch.reach((0.1, 0.0, -0.1)),
    }


@pytest.mark.parametrize("scene", [Scene(), Scene(Extension())], ids=["bare", "extension"])
@pytest.mark.parametrize(
    ("arm", "kind", "options"),
    [
        (TABLE_4, "tip", {"norm": "inf"}),
        (TABLE_4, "pose", {"mode": "nearest"}),
        (TABLE_4, "backbone", {"mode": "closest"}),
        (TABLE_4, "fetch", {"limited": True}),
        (SHORT, "backbone", {"mode": "closest"}),
        (SHORT, "tip", {}),
    ],
)
def test_they_agree_to_rounding(
    scene: Scene, arm: Arm, kind: str, options: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = (targets(arm)[kind],)
    given = (arm, scene, target, Statement(refinement=1, **options), stations_of(arm, target))
    ours = Explicit(*given)
    monkeypatch.setattr("model.unloaded.pulls.PullPolynomials.of", lambda *_: None)
    theirs = Explicit(*given)
    assert type(ours.x) is not type(theirs.x)
    limits, rng = Limits.of(arm, 20.0, total=60.0), np.random.default_rng(2)
    numbers = np.concatenate([t.parameters(arm) for t in target])
    unit = units(arm, limits)
    p = np.concatenate([numbers, [unit.max(), 60.0, 1e-6], unit])
    x = rng.uniform(0.02, 0.3, ours.n_free)
    first = [np.array(value) for f in (ours, theirs) for value in f.first_function(x, p)]
    lam = rng.normal(size=first[2].size)
    second = [f.second(x, p, 0.7, lam) for f in (ours, theirs)]
    pairs = [*zip(first[:4], first[4:], strict=True), second]
    for found, wanted in pairs:
        most = np.abs(wanted).max(initial=0.0)
        assert np.abs(found - wanted).max(initial=0.0) <= 1e-12 * (1e-3 + most)
