"""Compiled kernels: equal digits in every scene, and a clear error without a compiler."""

from __future__ import annotations

import shutil
from typing import Any

import numpy as np
import pytest

from octoplan.model import Arm, OctoplanError, Scene, settle, settle_many, tip_jacobian
from octoplan.model.effects import Current, ExactTendons, Extension, Shear, TipLoad, Weight
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.friction import Friction
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.model.stiffness import stiffness
from octoplan.model.support.errors import CompilerError
from octoplan.planner import plan
from octoplan.planner.targets import TipPosition
from tests.core.planner.cases import changed

ARM = Arm.from_paper("table-4")
SETS = np.random.default_rng(0).uniform(size=(20, 3, 4)) * np.array([0.1, 1.0, 4.0])[:, None]
T = SETS[0]
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


FEW = (Extension(), TipLoad((0.0, 0.01, 0.0)))
ALL = (Extension(), ExactTendons(), Weight(), Shear(), Current((0.1, 0.0, 0.0)), Friction(0.05))


@needs_compiler
def test_compiled_tips_have_the_digits_of_interpreted_ones() -> None:
    plain = settle_many(ARM, SETS, Scene(Extension()), accuracy=1e-8, compile=False)
    fast = settle_many(ARM, SETS, Scene(Extension()), accuracy=1e-8, compile=True)
    assert np.abs(plain.tip - fast.tip).max() < 1e-15


@needs_compiler
@pytest.mark.parametrize(
    "effects",
    [
        (),
        (Extension(), PrintedStatics()),
        FEW,
        pytest.param(ALL, marks=pytest.mark.slow),
        pytest.param(Scene.silicone().effects, marks=pytest.mark.slow),
    ],
    ids=["bare", "as printed", "few", "all", "silicone"],
)
def test_compiled_settles_have_the_digits_of_interpreted_ones(effects: tuple[Effect, ...]) -> None:
    scene = Scene(*effects)
    plain, fast = (settle(ARM, T, scene, 1e-5, compile=how) for how in (False, True))
    assert np.array_equal(plain.states, fast.states)
    assert np.array_equal(plain.position(0.1), fast.position(0.1))
    jacobian = [tip_jacobian(ARM, T, scene, 1e-5, compile=how) for how in (False, True)]
    assert np.array_equal(*jacobian)


@needs_compiler
def test_stiffness_has_the_digits_of_interpreted_ones() -> None:
    scene = Scene(*FEW)
    both = [stiffness(ARM, T, scene, "length", accuracy=1e-3, compile=how) for how in (False, True)]
    assert np.array_equal(both[0].compliance, both[1].compliance)
    assert both[0].shape.stability == both[1].shape.stability


@needs_compiler
@pytest.mark.parametrize(
    "scene",
    [Scene(Extension()), pytest.param(Scene(*FEW), marks=pytest.mark.slow)],
    ids=["unloaded", "loaded"],
)
def test_compiled_plans_have_the_digits_of_interpreted_ones(scene: Scene) -> None:
    target = TipPosition(settle(ARM, T, scene).tip)
    options: dict[str, Any] = {"tension_max": 20.0, "starts": 2}
    plain, fast = (plan(ARM, target, scene, compile=how, **options) for how in (False, True))
    assert np.array_equal(plain.tensions, fast.tensions)
    assert plain == fast
    assert plain.certificate == fast.certificate
    near = TipPosition(settle(ARM, 1.05 * T, scene).tip)
    after = [plan(ARM, near, scene, near=fast, compile=how, **options) for how in (False, True)]
    assert after[0] == after[1]
    assert [p.problem.machine_code for p in after] == [False, True]


def no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("octoplan.model.support.machine.compiled.find_spec", lambda _: None)


def test_a_missing_compiler_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    no_compiler(monkeypatch)
    with pytest.raises(OctoplanError, match=r"no C compiler was found as cc, gcc, clang; .*pip"):
        settle_many(ARM, SETS, Scene(), accuracy=1e-3, compile=True)
    with pytest.raises(CompilerError):
        plan(ARM, TipPosition((0.2, 0.0, -0.1)), Scene(Extension()), 20.0, compile=True)
    monkeypatch.setenv("CC", "nowhere --fast")
    with pytest.raises(CompilerError, match=r"'nowhere --fast'"):
        settle(ARM, T, Scene(*FEW), compile=True)


@pytest.mark.skipif(shutil.which("false") is None, reason="no program that fails")
def test_a_compiler_that_fails_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "false")
    with pytest.raises(OctoplanError, match="failed"):
        settle_many(ARM, SETS, Scene(), accuracy=1e-2, compile=True)


def test_without_a_compiler_auto_goes_on_and_warns(monkeypatch: pytest.MonkeyPatch) -> None:
    no_compiler(monkeypatch)
    with pytest.warns(RuntimeWarning, match="not compiled: no C compiler"):
        found = settle(ARM, T, Scene(*FEW), 1e-4, compile="auto")
    assert not found.machine_code
    assert np.array_equal(found.states, settle(ARM, T, Scene(*FEW), 1e-4).states)


@needs_compiler
def test_a_changed_answer_is_still_found_by_compiled_kernels() -> None:
    found = plan(ARM, TipPosition((0.3, 0.02, -0.05)), Scene(Extension()), 20.0, compile=True)
    other = changed(found, tensions=1.01 * found.tensions)
    assert other.shape.machine_code
    assert other != found
