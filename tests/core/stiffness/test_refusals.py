"""Impossible stiffnesses are refused by name, with the allowed values."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, Scene
from octoplan.model.effects import Extension
from octoplan.model.extensions.critical_load import critical_load_factor
from octoplan.planner import plan, stiffness
from octoplan.planner.targets import MinimumStiffness, Softest, Stiffest, TipPosition
from tests.core.stiffness.cases import STATICS, pulling
from tests.refusals import Refused, check_refusal

ARM, ALONG = Arm.from_paper("table-4"), (1.0, 0.0, 0.0)
GIVEN: dict[str, Any] = {
    "arm": ARM,
    "tensions": pulling("table-4", 21),
    "scene": Scene(Extension()),
}
K = stiffness(**GIVEN)
STIFFEST = [TipPosition((0.18, 0.12, 0.06)), Stiffest(ALONG)]
ASKED: list[tuple[dict[str, Any], str, str]] = [
    ({"hold": "lengths"}, "hold", '"tension" or "length"'),
    ({"at": 0.46}, "at", ""),
    ({"at": -0.1}, "at", ""),
    ({"at": 0.0}, "at", ""),
    ({"at": np.nan}, "at", ""),
    ({"at": "base"}, "at", "tip"),
    ({"tendon_EA": -1.0}, "tendon_EA", "above 0"),
    ({"tendon_EA": 0.0}, "tendon_EA", "above 0"),
    ({"tendon_EA": np.nan}, "tendon_EA", "above 0"),
    ({"tendon_EA": [1.0, 2.0]}, "tendon_EA", "above 0"),
    ({"tendon_EA": "steel"}, "tendon_EA", "above 0"),
    ({"scene": Scene.as_printed()}, "scene", "loads"),
    ({"scene": "paper"}, "scene", "Scene"),
    ({"arm": "table-4"}, "arm", "Arm"),
    ({"accuracy": 0.0}, "accuracy", ""),
]
TARGETS: list[tuple[Callable[[], object], str]] = [
    (lambda: MinimumStiffness((0, 0, 0), 1.0), "MinimumStiffness.direction"),
    (lambda: MinimumStiffness((1, 0), 1.0), "MinimumStiffness.direction"),
    (lambda: MinimumStiffness(((1, 0, 0), (1,)), 1.0), "MinimumStiffness.direction"),
    (lambda: MinimumStiffness(((1, 2, 0), (2, 1, 0), (0, 0, 1)), 1.0), "MinimumStiffness.direc"),
    (lambda: MinimumStiffness(((1, 1, 0), (0, 1, 0), (0, 0, 1)), 1.0), "MinimumStiffness.direc"),
    (lambda: MinimumStiffness(ALONG, 0.0), "MinimumStiffness.value"),
    (lambda: MinimumStiffness(ALONG, np.nan), "MinimumStiffness.value"),
    (lambda: MinimumStiffness(ALONG, 1.0, "lengths"), "MinimumStiffness.hold"),  # type: ignore[arg-type]
    (lambda: MinimumStiffness(ALONG, 1.0, "length", -1.0), "MinimumStiffness.tendon_EA"),
    (lambda: MinimumStiffness(ALONG, 1.0, "tension", 5.0), "MinimumStiffness.tendon_EA"),
    (lambda: Stiffest(ALONG, hold="length", tendon_EA=np.nan), "Stiffest.tendon_EA"),
    (lambda: Stiffest((0, 0, 0)), "Stiffest.direction"),
    (lambda: Softest((0, np.inf, 0)), "Softest.direction"),
    (lambda: Softest(ALONG, hold="motor"), "Softest.hold"),  # type: ignore[arg-type]
]
REFUSED: Refused = {
    **{str(change): (partial(stiffness, **GIVEN | change), f, t) for change, f, t in ASKED},
    **{f"{field} {i}": (make, field, "") for i, (make, field) in enumerate(TARGETS)},
    **{
        f"{read.__name__} at {s}": (partial(read, s), "s", "")
        for read in (K.section, K.torsional, K.axial)
        for s in ([0.1, np.nan], 0.46, "tip")
    },
    "what bears no loads": (
        lambda: critical_load_factor(ARM, np.zeros(12), STATICS["paper"]),
        "scene",
        "a scene with loads",
    ),
    "no limits": (lambda: plan(ARM, STIFFEST, STATICS["paper"]), "tension_max", "finite"),
    "as printed": (lambda: plan(ARM, STIFFEST, Scene.as_printed(), 9.0), "scene", "as printed"),
}


@pytest.mark.parametrize(("attempt", "field", "allowed"), REFUSED.values(), ids=REFUSED)
def test_what_has_no_stiffness_is_refused_by_name(
    attempt: Callable[[], object], field: str, allowed: str
) -> None:
    check_refusal(attempt, field, allowed)
