"""Tips of the paper's figures against those of an independent program."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, ConvergenceError, Scene, settle
from octoplan.model.effects import ExactTendons, Extension
from octoplan.model.forward import schemes_of

CASES = json.loads((Path(__file__).parents[1] / "data" / "reference_cases.json").read_text())
SCENES = {
    "as_printed": Scene.as_printed(),
    "paper": Scene(Extension()),
    "paper_no_extension": Scene(),
    "exact": Scene(Extension(), ExactTendons()),
    "exact_no_extension": Scene(ExactTendons()),
}
EACH = [
    pytest.param(
        *(case, key, scheme),
        id=f"{case['name']}-{key}-{scheme}",
        marks=[] if scheme.endswith("6") else [pytest.mark.slow],
    )
    for case in CASES["cases"]
    for key, scene in SCENES.items()
    for scheme in schemes_of(scene)
    if not scheme.endswith("2")
]
SECOND = [
    pytest.param(case, key, id=f"{case['name']}-{key}")
    for case in CASES["cases"]
    for key in ("paper", "paper_no_extension")
]


@pytest.mark.parametrize(("case", "key", "scheme"), EACH)
def test_tip_is_that_of_the_independent_program(
    case: dict[str, Any], key: str, scheme: str
) -> None:
    arm = Arm.from_paper(case["arm"])
    shape = settle(arm, case["tensions"], SCENES[key], accuracy=1e-8, scheme=scheme)
    assert shape.scheme == scheme
    far = 1e-8 if key.startswith("exact") else 1e-6
    assert np.linalg.norm(shape.tip - case["tip"][key]) <= far


@pytest.mark.parametrize(("case", "key"), SECOND)
def test_second_order_reaches_a_coarse_accuracy_and_owns_to_missing_a_fine_one(
    case: dict[str, Any], key: str
) -> None:
    arm = Arm.from_paper(case["arm"])
    shape = settle(arm, case["tensions"], SCENES[key], accuracy=1e-4, scheme="magnus2")
    assert np.linalg.norm(shape.tip - case["tip"][key]) <= 1e-4 * arm.length
    with pytest.raises(ConvergenceError):
        settle(arm, case["tensions"], SCENES[key], accuracy=1e-8, scheme="magnus2")


def test_every_statics_of_the_paper_is_among_the_references() -> None:
    assert len(CASES["cases"]) == 5
    assert all(set(SCENES) <= set(case["tip"]) for case in CASES["cases"])


@pytest.mark.parametrize("name", ["Figure 14", "Figure 15"])
def test_printed_statics_miss_the_consistent_tip_of_a_fetch_by_7_mm(name: str) -> None:
    case = next(c for c in CASES["cases"] if c["name"] == name)
    arm = Arm.from_paper(case["arm"])
    tips = [settle(arm, case["tensions"], SCENES[key]).tip for key in ("as_printed", "paper")]
    assert 6.5e-3 < np.linalg.norm(tips[0] - tips[1]) < 7.1e-3
