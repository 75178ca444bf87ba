"""The certificate of a motion fails for each thing that is not as asked, and for it alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from planner.trajectory.certificate import SAMPLED, MotionCertificate

SOUND = MotionCertificate(residuals=(0.0,), inequalities=(0.0,), bounds=0.0, rate=1.0)
SPOILT: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "target 0 is off": ({"residuals": (0.9e-6,)}, {"residuals": (1.1e-6,)}),
    "target 0 is": ({"inequalities": (-0.9e-6,)}, {"inequalities": (-1.1e-6,)}),
    "tension limit": ({"bounds": 0.0}, {"bounds": 1e-12}),
    "rate of tension": ({"rate": 1.0}, {"rate": 1.001}),
    "rate of stroke": ({"stroke_rate": 1 + 0.9 * SAMPLED}, {"stroke_rate": 1 + 1.1 * SAMPLED}),
    "acceleration of a stroke": (
        {"stroke_acceleration": 1 + 0.9 * SAMPLED},
        {"stroke_acceleration": 1 + 1.1 * SAMPLED},
    ),
    "tip's acceleration": (
        {"tip_acceleration": 1 + 0.9 * SAMPLED},
        {"tip_acceleration": 1 + 1.1 * SAMPLED},
    ),
    "jumps on its way to waypoint 2": ({"jumps": ()}, {"jumps": (2,)}),
    "less than asked": ({"clearance": 0.0}, {"clearance": -1e-9}),
}


@pytest.mark.parametrize("name", SPOILT)
def test_each_check_fails_just_above_its_tolerance_and_passes_just_below(name: str) -> None:
    allowed, spoilt = SPOILT[name]
    assert SOUND.passed, SOUND.failures
    assert replace(SOUND, **allowed).passed
    (failure,) = replace(SOUND, **spoilt).failures
    assert name in failure
