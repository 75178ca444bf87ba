"""Tips of the paper's figures against an independent program."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import ExactTendons, Extension
from tests.collocation import collocated

CASES = json.loads((Path(__file__).parents[2] / "data" / "reference_cases.json").read_text())
SCENES = {
    "as_printed": Scene.as_printed(),
    "paper": Scene(Extension()),
    "paper_no_extension": Scene(),
    "exact": Scene(Extension(), ExactTendons()),
    "exact_no_extension": Scene(ExactTendons()),
}
EACH = [
    pytest.param(case, key, id=f"{case['name']}-{key}") for case in CASES["cases"] for key in SCENES
]


@pytest.mark.parametrize(("case", "key"), EACH)
def test_tip_is_that_of_the_independent_program(
    case: dict[str, Any], key: str, deviation: Callable[..., float]
) -> None:
    arm, T, scene = Arm.from_paper(case["arm"]), case["tensions"], SCENES[key]
    shapes = [settle(arm, T, scene, accuracy=1e-8)]
    if key != "as_printed":
        shapes.append(collocated(arm, T, scene, 3, 24))
    far = (1e-8 if key.startswith("exact") else 1e-6) / arm.length
    for shape in shapes:
        assert deviation(np.linalg.norm(shape.tip - case["tip"][key]), 0.0, arm.length) <= far


def test_every_statics_of_the_paper_is_among_the_references() -> None:
    assert len(CASES["cases"]) == 5
    assert all(set(SCENES) <= set(case["tip"]) for case in CASES["cases"])


@pytest.mark.parametrize("name", ["Figure 14", "Figure 15"])
def test_printed_statics_miss_the_consistent_tip_of_a_fetch_by_7_mm(name: str) -> None:
    case = next(c for c in CASES["cases"] if c["name"] == name)
    arm = Arm.from_paper(case["arm"])
    tips = [settle(arm, case["tensions"], SCENES[key]).tip for key in ("as_printed", "paper")]
    assert 6.5e-3 < np.linalg.norm(tips[0] - tips[1]) < 7.1e-3
