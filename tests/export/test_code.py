"""Exported C compiles without a warning, agrees with Python, and needs no system calls."""

from __future__ import annotations

import re
import shutil
import subprocess
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, Material, Scene, settle, tip_jacobian
from octoplan.model.effects import ExactTendons, Extension
from octoplan.model.forward import explicit_map
from octoplan.model.stiffness import tip_jacobian_function
from octoplan.planner import export
from tests.commands import study
from tests.core.effects.test_turning_tendons import ANGLE, NU, TURNING, E, L, R, Y, tip_of_helix
from tests.export.cases import BENT, NO_DOUBLE, SCENES, SETTLING, TABLE_4, Library, compiled

AGREES = {"double": 1e-12, "float": 1e-5}
# The whole map as printed takes the compiler half a minute.
LONG = {("as printed", "double")}
CASES = [
    pytest.param(*case, marks=[pytest.mark.slow] * (case in LONG))
    for case in product(SCENES, AGREES)
]


@pytest.mark.quick("curved tendons-double")
@pytest.mark.parametrize(("name", "precision"), CASES)
def test_it_compiles_strictly_and_its_test_vector_agrees(
    name: str, precision: str, tmp_path: Path
) -> None:
    arm, scene, T = SCENES[name]
    export(arm, scene, tmp_path, T, 1e-4, precision)
    program = compiled(tmp_path, *NO_DOUBLE * (precision == "float"))
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert done.stdout.count(": agrees\n") == 6


def test_in_single_precision_no_constant_is_lost(tmp_path: Path) -> None:
    arm, scene, T = SETTLING["silicone"]
    export(arm, scene, tmp_path, T, 1e-2, "float", "octo")
    constants = re.findall(r"=(-?\d\.\d+e[+-]\d+)f;", (tmp_path / "octo.c").read_text())
    given = np.array([float(constant) for constant in constants])
    assert given.size > 0
    assert np.all(np.float32(given[given != 0]) != 0)
    assert np.all(np.isfinite(np.float32(given)))


@pytest.mark.quick("exact tendons-float")
@pytest.mark.parametrize("precision", AGREES)
@pytest.mark.parametrize("name", SETTLING)
def test_sections_that_settle_by_newton_agree_too(
    name: str, precision: str, tmp_path: Path
) -> None:
    arm, scene, T = SETTLING[name]
    found = export(arm, scene, tmp_path, T, 1e-4, precision, "octo")
    program = compiled(tmp_path, *NO_DOUBLE * (precision == "float"))
    done = subprocess.run([program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    code = Library(tmp_path, "octo", arm.n_tendons, found.shape.s.size, precision)
    forward = explicit_map(arm, scene, found.shape.refinement)
    rng = np.random.default_rng(4)
    for _ in range(20):
        other = rng.uniform(0, 0.5, arm.n_tendons)
        status, tip, _ = code.tip(other)
        assert status == 0
        assert np.abs(tip - forward.run(other)[0][-1, 4:7]).max() <= AGREES[precision] * arm.length


def test_code_of_a_helix_agrees_with_an_independent_balance(tmp_path: Path) -> None:
    anchorage = Anchorage(L, Linear(Y, Y), (ANGLE, ANGLE + np.pi / 2), TURNING)
    arm = Arm(L, Linear(R, R), (anchorage,), Material(E, NU))
    scene = Scene(Extension(), ExactTendons())
    found = export(arm, scene, tmp_path, [1.5, 0.0], 1e-6, "double", "octo")
    code = Library(tmp_path, "octo", arm.n_tendons, found.shape.s.size, "double")
    for T in (0.3, 1.5):
        status, tip, _ = code.tip(np.array([T, 0.0]))
        assert status == 0
        assert np.abs(tip - tip_of_helix(T)).max() < 1e-6 * L


@pytest.mark.quick("test_tension")
@pytest.mark.parametrize("place", ["test_tension", "test_position", "test_frame", "test_turn"])
def test_the_check_fails_where_a_number_is_not_python_s(place: str, tmp_path: Path) -> None:
    arm, scene, T = SCENES["the paper's"]
    export(arm, scene, tmp_path, T, 1e-3, "double", "octo")
    header = tmp_path / "test_vector.h"
    head, values = header.read_text().split(f"{place}[", 1)
    start = values.index("{") + 1
    end = values.index(",", start)
    header.write_text(f"{head}{place}[{values[:start]} {values[start:end]} + 1e-6{values[end:]}")
    done = subprocess.run([compiled(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "DISAGREES" in done.stdout


@pytest.mark.quick("short tendons-float")
@pytest.mark.parametrize(("name", "precision"), CASES)
def test_it_agrees_with_settle_and_tip_jacobian_at_other_tensions(
    name: str, precision: str, tmp_path: Path
) -> None:
    arm, scene, T = SCENES[name]
    found = export(arm, scene, tmp_path, T, 1e-6, precision, "octo")
    code = Library(tmp_path, "octo", arm.n_tendons, found.shape.s.size, precision)
    forward = explicit_map(arm, scene, found.shape.refinement)
    rng, allowed = np.random.default_rng(3), AGREES[precision]
    for _ in range(5):
        other = np.ravel(np.concatenate([np.ravel(row) for row in T])) * rng.uniform(0, 1)
        status, tip, frame = code.tip(other)
        assert status == 0
        poses = forward.run(other)[0]
        assert np.abs(tip - poses[-1, 4:7]).max() <= allowed * arm.length
        shape = settle(arm, other, scene, 1e-8)
        assert np.linalg.norm(tip - shape.tip) <= (1e-6 + allowed) * arm.length
        assert np.abs(frame - shape.tip_frame).max() <= 1e-4
        status, positions, frames = code.nodes(other)
        assert status == 0
        assert np.abs(positions - poses[:, 4:7]).max() <= allowed * arm.length
        assert np.abs(frames @ np.swapaxes(frames, 1, 2) - np.eye(3)).max() <= allowed
        jacobian, wanted = (
            code.jacobian(other),
            np.array(tip_jacobian_function(arm, scene, found.shape.refinement)(other)),
        )
        true = tip_jacobian(arm, other, scene, 1e-8)
        for rows in (slice(3), slice(3, 6)):
            scale = np.abs(wanted[rows]).max()
            assert np.abs(jacobian[rows] - wanted[rows]).max() <= allowed * scale
            assert np.abs(jacobian[rows] - true[rows]).max() <= 1e-4 * scale


def test_crushed_arms_and_nan_are_told_and_results_may_be_left_out(tmp_path: Path) -> None:
    arm, scene, T = SCENES["the paper's"]
    found = export(arm, scene, tmp_path, T, 1e-1, name="octo")
    code = Library(tmp_path, "octo", arm.n_tendons, found.shape.s.size, "double")
    assert code.without_results(T) == 0
    assert code.without_results(np.full(12, 1000.0)) == 1
    assert code.nodes(np.full(12, 1000.0))[0] == 1
    assert code.without_results(np.full(12, np.nan)) == 1
    assert code.without_results(T) == 0


@pytest.mark.parametrize("name", ["bending alone", "curved tendons"])
@pytest.mark.parametrize("no_number", [np.nan, np.inf])
def test_a_tension_that_is_no_number_is_told_in_any_scene(
    name: str, no_number: float, tmp_path: Path
) -> None:
    """An arm that does not shorten was OK under nan."""
    arm, scene, T = SCENES[name]
    found = export(arm, scene, tmp_path, T, 1e-2, name="octo")
    code = Library(tmp_path, "octo", arm.n_tendons, found.shape.s.size, "double")
    assert code.without_results(np.append(np.zeros(arm.n_tendons - 1), no_number)) == 1
    assert code.without_results(np.zeros(arm.n_tendons)) == 0


def test_code_of_tendons_that_run_in_curves_goes_through_its_steps_in_a_loop(
    tmp_path: Path,
) -> None:
    """Steps were unrolled, some hundred kilobytes each dozen: 9 s of the compiler."""
    arm, scene, T = SCENES["curved tendons"]
    sizes = []
    for accuracy in (1e-3, 1e-9):
        export(arm, scene, tmp_path, T, accuracy, name="octo")
        sizes.append((tmp_path / "octo.c").stat().st_size)
    assert sizes[0] < 300_000
    assert sizes[1] < 2 * sizes[0]


def test_a_finer_accuracy_gives_a_finer_mesh(tmp_path: Path) -> None:
    scene = SCENES["the paper's"][1]
    made = [export(TABLE_4, scene, tmp_path, BENT, a) for a in (1e-3, 1e-9)]
    # Work arrays hold one step if strains have closed forms.
    assert made[0].static_bytes == made[1].static_bytes < 8192
    coarse, fine = (own.shape for own in made)
    assert coarse.s.size < fine.s.size
    assert coarse.error <= 1e-3
    assert fine.error <= 1e-9
    assert f"arm_s[ARM_NODES] = {{\n    {0:.16e}" in (tmp_path / "arm.c").read_text()
    assert f"#define ARM_NODES {fine.s.size} " in (tmp_path / "arm.h").read_text()


TOOLS = ("arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm")
MISSING = [tool for tool in TOOLS if shutil.which(tool) is None]
needs_tools = pytest.mark.skipif(bool(MISSING), reason=f"not installed: {MISSING}")
ROW = re.compile(r"([\d.]+) kB +([\d.]+) kB +(\d+) B +(\d+) = +[\d.]+ kHz +(\d+) = ")
REPLAN = re.compile(r"([\d.]+) kB +([\d.]+) kB +(\d+) B +(\d+) = +\d+ Hz +(\d+)")
SHORT = """
tensions = [0.6, 0.0, 0.2, 1.0, 0.0]
[arm]
length_mm = 300.0
radius_mm = [10.0, 4.0]
sections = [
  { at_mm = 250.0, offset_mm = [8.0, 4.0], angles_deg = [0.0, 115.0, 230.0] },
  { at_mm = 100.0, offset_mm = [8.0, 7.0], angles_deg = [60.0, 170.0] },
]
[effects]
"""


@needs_tools
@pytest.mark.quick("float")
@pytest.mark.parametrize("precision", ["float", "double"])
def test_it_agrees_there_and_serves_a_kilohertz_loop(precision: str) -> None:
    shown = study("microcontroller", "--precision", precision, "--accuracy", "1e-3")
    (cost,) = ROW.findall(shown)
    flash, static, stack, tip, jacobian = map(float, cost)
    assert tip < jacobian
    # A count, not a time: 480 MHz allow for 480 000 a millisecond.
    assert tip + jacobian < 480_000
    assert flash < 65.5 and static < 8.2 and stack < 4096


@needs_tools
@pytest.mark.slow
@pytest.mark.parametrize("effects", ["", "extension = true", "as_printed = true"])
def test_other_scenes_agree_there(effects: str, tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(SHORT + effects)
    assert ROW.search(study("microcontroller", scene, "--precision", "double"))


@needs_tools
@pytest.mark.slow
def test_a_moving_target_is_followed_fifty_times_a_second() -> None:
    shown = study("microcontroller", "--inverse", "--precision", "float")
    ((flash, static, stack, _, most),) = REPLAN.findall(shown)
    # A count, not a time: 480 MHz allow for 9.6 million.
    assert int(most) < 9_600_000
    assert float(flash) < 262 and float(static) < 16.4 and int(stack) < 8192


@pytest.mark.slow
@pytest.mark.skipif(not MISSING, reason="all tools are installed")
def test_the_study_says_what_is_missing() -> None:
    assert study("microcontroller") == f"not measured, not installed: {', '.join(MISSING)}\n"
