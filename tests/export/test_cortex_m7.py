"""Exported C on a Cortex-M7, emulated: agrees with Python, and in how many instructions."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from tests.commands import study

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


@pytest.mark.skipif(not MISSING, reason="all tools are installed")
def test_the_study_says_what_is_missing() -> None:
    assert study("microcontroller") == f"not measured, not installed: {', '.join(MISSING)}\n"
