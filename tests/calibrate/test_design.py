"""Arms are designed for tasks: gradients, optima, limits, and refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, InputError, Linear, Scene, settle
from octoplan.model.effects import Extension, Weight
from octoplan.model.support.progress import OutOfTime, time_limit
from octoplan.planner import ManufacturingLimits, Reach, Unknown, design, plan, stiffness
from octoplan.planner.extensions.fit.design_program import DesignProgram, Targets
from octoplan.planner.extensions.fit.manufacturing import Objective
from octoplan.planner.extensions.fit.unknowns import Parameters
from octoplan.planner.frontends.cli import main
from octoplan.planner.limits import TendonLimits
from octoplan.planner.solve.ipopt import nlp_derivatives
from octoplan.planner.targets import Backbone, Stiffest, TipPosition
from tests.differences import fourth_order

PAPER = Scene(Extension())
RADIUS = Unknown("arm.radius_mm[1]", 3, 8)
PLACE = Unknown("arm.sections[1].at_mm", 60, 150)
OFFSET = Unknown("arm.sections[1].offset_mm[0]", 3, 9)


def _arm() -> Arm:
    sections = (Anchorage(0.2, Linear(0.007, 0.003)), Anchorage(0.09, Linear(0.006, 0.005)))
    return Arm(0.2, Linear(0.01, 0.005), sections)


def _tips(scene: Scene = PAPER) -> list[TipPosition]:
    pulls = ([0, 0, 0.05, 0, 0, 0.5, 0, 0], [0.1, 0, 0, 0, 0, 0, 0.8, 0])
    return [TipPosition(tuple(settle(_arm(), T, scene).tip.tolist())) for T in pulls]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("objective", "scene"),
    [
        ("effort", PAPER),
        pytest.param(
            *(Stiffest((0, 0.3, 1)), Scene(Extension(), Weight((0, 0, -3.0)))),
            marks=pytest.mark.slow,
        ),
        (Reach((0, 1, 0)), PAPER),
    ],
)
def test_derivatives_of_the_program_are_those_of_differences(
    objective: Objective, scene: Scene
) -> None:
    """Gradients by tensions and states are exact; by numbers of the arm, as differences."""
    parameters = Parameters.of(_arm(), scene, [RADIUS, PLACE, OFFSET])
    tasks: list[Targets] = [(tip,) for tip in _tips()]
    program = DesignProgram(
        parameters, tasks, TendonLimits.of(_arm(), 5.0), ManufacturingLimits(wall=1e-4), objective
    )
    rng = np.random.default_rng(0)
    T = rng.uniform(0, 0.1, (len(program.tasks), 8))
    of, x = nlp_derivatives(program.stated.nlp), program.initial_variables(parameters.start, T)
    x = x + 1e-3 * rng.normal(size=x.size)
    lam = rng.normal(size=program.stated.lam.numel())

    def first(z: np.ndarray) -> list[np.ndarray]:
        return [np.array(of[name](z, [])[1]) for name in ("grad_f", "jac_g")]

    def values(z: np.ndarray) -> np.ndarray:
        f, g = (np.array(v) for v in program.stated.values(z, []))
        return np.vstack([g, f]).ravel()

    def slopes(z: np.ndarray) -> np.ndarray:
        gradient, J = first(z)
        return np.asarray(gradient.ravel() + J.T @ lam)

    gradient, J = first(x)
    H = np.array(of["hess_lag"](x, [], 1.0, lam))
    H += np.triu(H, 1).T
    # Numbers of the arm count as linear in the unknowns: the Hessian lacks their second
    # derivatives.
    for k, far, curved in ((-3, 1e-6, 1e-5), (-2, 1e-6, 1e-5), (2, 1e-9, 1e-7), (-12, 1e-9, 1e-7)):
        along = np.eye(x.size)[k]
        wanted = fourth_order(lambda y, v=along: values(x + y * v), 1e-4)
        error = np.abs(np.append(J[:, k], gradient[k]) - wanted).max()
        assert error <= far * max(np.abs(wanted).max(), 1e-3)
        wanted = fourth_order(lambda y, v=along: slopes(x + y * v), 1e-4)
        off = np.abs(H[:, k] - wanted)[: x.size - 3 if k in (-3, -2) else None]
        assert off.max() <= curved * max(np.abs(wanted).max(), 1e-3)


def test_a_time_limit_that_ends_the_program_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """CasADi reported an error of its callback as an error of CasADi."""
    parameters = Parameters.of(_arm(), PAPER, [RADIUS])
    program = DesignProgram(
        parameters, [(_tips()[0],)], TendonLimits.of(_arm(), 5.0), ManufacturingLimits()
    )
    T = np.full((1, 8), 0.1)
    variables = program.initial_variables(parameters.start, T)
    monkeypatch.setattr(program, "initial_variables", lambda *_: variables)
    with pytest.raises(OutOfTime), time_limit(0.0):
        program.solve(parameters.start, T)


@pytest.mark.slow
def test_an_arm_is_designed_for_stiffness() -> None:
    """A thicker tip is stiffer: the optimum is at the bound, or at the bounds of the tensions."""
    up = Stiffest((0.0, 0.0, 1.0))
    found = design(_arm(), _tips()[:1], [RADIUS], PAPER, 5.0, objective=up, n_starts=1, starts=2)
    assert found.feasible
    assert "stiffness of the tip" in found.outcome
    C = [stiffness(found.arm, own.tensions, PAPER).compliance[2, 2] for own in found.plans]
    assert found.value == pytest.approx(1 / C[0], rel=1e-6)
    assert found.gain > 0.1
    with pytest.raises(InputError, match="least effort"):
        found.sensitivity  # noqa: B018


@pytest.mark.slow
def test_a_stiffest_modulus_is_no_softer_than_others() -> None:
    """Forces that compliances are counted by do not change with the arm."""
    up, modulus = Stiffest((0.0, 0.0, 1.0)), Unknown("arm.E_kPa", 60, 200)
    tasks = _tips()[:1]
    found = design(_arm(), tasks, [modulus], PAPER, 5.0, objective=up, n_starts=1, starts=2)
    arms = [found.parameters.setting(np.array([E])).arm for E in (60.0, 200.0)]
    plans = [plan(arm, [*tasks, up], PAPER, 5.0, starts=2) for arm in arms]
    of_tip = [stiffness(own.arm, own.tensions, PAPER).compliance[2, 2] for own in plans]
    assert found.value >= (1 - 1e-6) * max(found.value_before, 1 / min(of_tip))


@pytest.mark.slow
def test_an_arm_is_designed_for_reach() -> None:
    """Tendons farther out bend more: the tip reaches farther aside, as a search confirms."""
    aside = Reach((0.0, -1.0, 0.0))
    found = design(_arm(), _tips()[:1], [OFFSET], PAPER, 0.8, objective=aside, n_starts=1, starts=2)
    assert found.feasible
    assert found.reaches is not None
    assert max(max(T) for T in found.reaches) <= 0.8 * (1 + 1e-9)
    assert found.value > found.value_before
    assert "reach" in found.outcome
    rng = np.random.default_rng(0)
    for _ in range(200):
        T = 0.8 * rng.uniform(0, 1, 8) * (rng.uniform(0, 1, 8) < 0.5)
        assert -settle(found.arm, T, PAPER).tip[1] <= found.value * (1 + 1e-6)


@pytest.mark.slow
def test_a_designed_arm_is_cheaper_and_every_plan_is_certified() -> None:
    found = design(_arm(), _tips(), [RADIUS, OFFSET], PAPER, 5.0, starts=3, n_starts=1)
    assert found.feasible
    assert found.gain > 0.1
    assert "% less" in found.outcome
    assert found.arm.radius.evaluate(np.array([0.2]), 0.2)[0][0] == pytest.approx(
        found.values[0] * 1e-3
    )
    for own, tip in zip(found.plans, _tips(), strict=True):
        assert own.certificate.passed
        assert settle(found.arm, own.tensions, PAPER).tip == pytest.approx(tip.position, abs=1e-6)


@pytest.mark.slow
def test_the_optimum_is_that_of_a_search_over_plans() -> None:
    (tip, _) = _tips()
    bounded = Unknown("arm.sections[1].at_mm", 80, 130)
    found = design(_arm(), [tip], [bounded], PAPER, 5.0, starts=3, n_starts=2)
    parameters = found.parameters
    places = np.linspace(80, 130, 4)
    arms = [parameters.setting(np.array([x])).arm for x in places]
    plans = [plan(arm, tip, PAPER, 5.0, starts=3) for arm in arms]
    efforts = [own.effort for own in plans if own.certificate.passed]
    assert len(efforts) > 1
    assert found.effort <= min(efforts) * (1 + 1e-6)


@pytest.mark.quick("arm.radius_mm[1]")
@pytest.mark.parametrize("key", ["arm.sections[1].offset_mm[0]", "arm.radius_mm[1]"])
def test_sensitivity_is_that_of_plans_made_anew(key: str) -> None:
    """At bounds the effort still falls, at the rate of differences of neighbouring arms."""
    start = {"arm.sections[1].offset_mm[0]": 6.0, "arm.radius_mm[1]": 5.0}[key]
    narrow = Unknown(key, start - 0.01, start + 0.01)
    found = design(_arm(), _tips(), [narrow], PAPER, 5.0, starts=3, n_starts=1)
    h = 1e-3

    def effort(x: float) -> float:
        arm = found.parameters.setting(np.array([found.values[0] + x])).arm
        plans = [plan(arm, tip, PAPER, 5.0, starts=3, accuracy=1e-9) for tip in _tips()]
        return float(np.linalg.norm([own.effort for own in plans]))

    wanted = (effort(h) - effort(-h)) / (2 * h)
    assert found.sensitivity == pytest.approx([wanted], rel=1e-3)


@pytest.mark.quick("1")
@pytest.mark.parametrize("count", [1, 2])
def test_a_stiffest_arm_is_no_softer_than_any_corner_of_the_bounds(count: int) -> None:
    tip = Unknown("arm.sections[0].offset_mm[1]", 1, 4)
    unknowns, up = [tip, OFFSET][:count], Stiffest((0, 0, 1))
    task, stiff = _tips()[0], []
    found = design(_arm(), [task], unknowns, PAPER, 5.0, objective=up, n_starts=1, starts=2)
    assert found.feasible, found.outcome
    parameters = Parameters.of(_arm(), PAPER, unknowns)
    for corner in product(*((own.lower, own.upper) for own in unknowns)):
        p = plan(
            parameters.setting(np.array(corner)).arm,
            [task, up],
            PAPER,
            5.0,
            starts=1,
        )
        if p.reached:
            stiff.append(1 / stiffness(p.arm, p.tensions, PAPER).compliance[2, 2])
    assert stiff
    assert found.value >= max(stiff) * (1 - 1e-6)


def test_a_number_at_a_bound_is_tried_at_the_other_one() -> None:
    found = design(_arm(), _tips()[:1], [OFFSET], PAPER, 5.0, starts=2, n_starts=1)
    assert "At a bound" in found.outcome
    assert len(found.optima) == 2
    assert found.effort**2 / 2 == pytest.approx(min(found.optima), rel=1e-5)


def test_what_can_be_made_is_kept_to() -> None:
    wall = 0.0015
    with pytest.raises(InputError, match="it misses it by"):
        design(_arm(), _tips(), [RADIUS], PAPER, 5.0, manufacturing=ManufacturingLimits(wall=0.01))
    found = design(
        _arm(),
        _tips(),
        [RADIUS, OFFSET],
        PAPER,
        5.0,
        manufacturing=ManufacturingLimits(wall),
        starts=2,
        n_starts=1,
    )
    assert ManufacturingLimits(wall).margins(found.arm).min() > -1e-9
    assert "wall 1.5 mm" in found.outcome


@pytest.mark.slow
def test_a_task_that_no_arm_meets_is_named() -> None:
    far = TipPosition((0.5, 0.0, 0.0))
    found = design(_arm(), [_tips()[0], far], [RADIUS], PAPER, 5.0, starts=1, n_starts=1)
    assert not found.feasible
    assert np.isnan(found.gain)
    assert "Task 1 is not met" in found.outcome
    with pytest.raises(InputError, match="meets all tasks"):
        found.sensitivity  # noqa: B018


@pytest.mark.slow
def test_the_limit_that_holds_a_task_is_named() -> None:
    bent = TipPosition(tuple(settle(_arm(), [0, 0, 0.05, 0, 0, 0.8, 0, 0], PAPER).tip.tolist()))
    found = design(_arm(), [bent], [RADIUS], PAPER, 1e-3, starts=2, n_starts=1)
    assert not found.feasible
    assert "Task 0 is not met" in found.outcome
    assert "At the tension limit: T_" in found.outcome


@pytest.mark.parametrize(
    ("targets", "unknowns", "told"),
    [
        ([], [RADIUS], "at least one task"),
        (TipPosition((0.1, 0, 0)), [RADIUS], "a sequence of targets"),
        (
            [TipPosition((0.1, 0, 0))],
            [Unknown("arm.base_position_mm[0]", -1, 1)],
            "except its base",
        ),
        ([TipPosition((0.1, 0, 0))], [Unknown("effects.weight.g[2]", -1, 1)], "weight"),
        ([TipPosition((0.1, 0, 0))], [replace(RADIUS, prior=(5, 1))], "without both in a design"),
        ([Backbone(((0.1, 0.0, 0.0),), (0.1,))], [RADIUS], "met exactly"),
    ],
)
def test_what_does_not_fit_is_refused(targets: Any, unknowns: Any, told: str) -> None:
    with pytest.raises(InputError, match=told):
        design(_arm(), targets, unknowns, PAPER, 5.0)


@pytest.mark.parametrize(
    ("objective", "most", "told"),
    [
        ("stiffness", 5.0, "Reach"),
        (np.zeros(3), 5.0, "Reach"),
        (Stiffest((0, 0, 1), hold="length"), 5.0, "tensions held"),
        (Reach((1, 0, 0)), np.inf, "finite tensions"),
    ],
)
def test_objectives_that_cannot_be(objective: Any, most: float, told: str) -> None:
    with pytest.raises(InputError, match=told):
        design(_arm(), _tips(), [RADIUS], PAPER, most, objective=objective)


def test_manufacturing_limits_of_another_type_are_rejected() -> None:
    wanted = "manufacturing = 3: must be a ManufacturingLimits"
    with pytest.raises(InputError, match=wanted):
        design(_arm(), _tips(), [RADIUS], PAPER, 5.0, manufacturing=3)  # type: ignore[arg-type]


def test_a_reach_has_a_direction() -> None:
    with pytest.raises(InputError, match="not 0"):
        Reach((0.0, 0.0, 0.0))


FILE = """
[scene.arm]
length_mm = 200.0
radius_mm = [10.0, 5.0]
sections = [
  { at_mm = 200.0, offset_mm = [7.0, 3.0] },
  { at_mm = 90.0, offset_mm = [6.0, 5.0] },
]
[scene.effects]
extension = true
[scene.limits]
tension_max = 5.0
[[tasks]]
type = "tip-position"
position_mm = [185.0, 30.0, 20.0]
[[unknowns]]
key = "arm.radius_mm[1]"
lower = 3.0
upper = 8.0
"""


@pytest.mark.slow
def test_a_file_asks_for_an_objective(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "design.toml"
    path.write_text(FILE + '[objective]\ntype = "reach"\ndirection = [0, 0, 1]\n')
    assert main(["design", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["objective"] == "Reach"
    assert told["value"] >= told["value_before"]
    path.write_text(FILE + '[objective]\ntype = "stiffest"\ndirection = [0, 0, 0]\n')
    assert main(["design", str(path)]) == 2
    assert "not 0" in capsys.readouterr().err


def test_the_command_line_designs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "design.toml"
    path.write_text(FILE)
    assert main(["design", str(path)]) == 0
    told = capsys.readouterr().out
    assert "1 task, 1 unknown: effort" in told
    assert "arm.radius_mm[1]" in told
    path.write_text(FILE.replace("radius_mm[1]", "radius_mm[3]"))
    assert main(["design", str(path)]) == 2
    assert "[0] to [1]" in capsys.readouterr().err
