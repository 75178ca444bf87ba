"""Ctrl-C and SIGTERM at any moment: exit code and files as documented by --help."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
SCENE = """
tensions = [[0.5, 0, 0, 0], [0, 0, 1, 0], [2, 0, 0, 0]]
[arm]
preset = "table-4"
[effects]
extension = true
[target]
type = "tip-position"
position_mm = [200, 100, 100]
[limits]
tension_max = 20.0
"""
SWEEP = """
scene = "scene.toml"
[sweep]
compute = "stiffness"
[[sweep.axes]]
key = "arm.E_kPa"
start = 80.0
stop = 120.0
count = 20
"""
C_FILES = {"Makefile", "main.c", "scene.c", "scene.h", "test_vector.h"}
# Files of each command: all are written, or none.
COMMANDS: dict[str, tuple[list[str], set[str]]] = {
    "plan": (["scene.toml", "--out", "out"], {"plan.csv", "plan.json", "plan.png", "shape.csv"}),
    "settle": (["scene.toml", "--out", "out"], {"shape.csv", "shape.json", "shape.png"}),
    "stiffness": (["scene.toml", "--out", "out"], {"stiffness.json", "stiffness.png"}),
    "effects": (["scene.toml", "--out", "out"], {"effects.json", "effects.png"}),
    "export": (["scene.toml", "--to", "out"], C_FILES),
    "sweep": (["sweep.toml", "--out", "out/a.nc"], {"a.nc"}),
}
# Duration of the slowest command from its start [s].
ENDS = 4.0


def ended(command: str, number: signal.Signals, after: float, folder: Path) -> int:
    """Return the exit code of a command that is sent a signal; check messages and files."""
    (folder / "scene.toml").write_text(SCENE)
    (folder / "sweep.toml").write_text(SWEEP)
    if command == "sweep":
        (folder / "out").mkdir(exist_ok=True)
    argv, files = COMMANDS[command]
    begun = folder / "begun"
    # The command has started when signals are handled: the next step imports the command line.
    begin = f"import sys; sys.path.insert(0, {str(ROOT)!r}); import octoplan; "
    begin += "sys.addaudithook(lambda event, of: event == 'import' "
    begin += (
        f"and of[0] == 'octoplan.planner.frontends.cli' and open({str(begun)!r}, 'w').close()); "
    )
    process = subprocess.Popen(
        [sys.executable, "-c", begin + "sys.exit(octoplan.main())", command, *argv],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    # A busy machine takes seconds to begin; until then a signal ends Python and no command.
    while not begun.exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    time.sleep(after)
    process.send_signal(number)
    shown, told = process.communicate()
    name = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}[number]
    assert process.returncode in (0, 128 + number), told
    said = f"octoplan: {name}; "
    assert told == "" if process.returncode == 0 else told.startswith(said), told
    assert process.returncode == 0 or shown == "" or (folder / "out").exists()
    out = folder / "out"
    left = {path.name for path in out.iterdir()} if out.is_dir() else set()
    if process.returncode:
        kept = told.removeprefix(said).strip()
        assert ("nothing was written" in kept) == (not left), kept
    left.discard("a.nc.chunks" if process.returncode else "")
    assert left in (files, set()), left
    assert left == files or process.returncode != 0
    return process.returncode


@pytest.mark.quick("settle-2-0.1")
@pytest.mark.parametrize(("command", "number", "after"), [
    ("settle", signal.SIGINT, 0.1), ("plan", signal.SIGTERM, 1.2), ("sweep", signal.SIGINT, 2.2),
])  # fmt: skip
def test_a_command_that_is_ended_leaves_all_or_nothing(
    command: str, number: signal.Signals, after: float, tmp_path: Path
) -> None:
    ended(command, number, after, tmp_path)


LAST = """
import os, signal, sys
import octoplan, octoplan.planner.frontends.cli
run = octoplan.planner.frontends.cli.main
octoplan.planner.frontends.cli.main = lambda: (run(), os.kill(os.getpid(), signal.SIGTERM))
sys.exit(octoplan.main())
"""


def test_what_was_written_before_a_signal_is_told(tmp_path: Path) -> None:
    """The message was that nothing was written."""
    (tmp_path / "scene.toml").write_text(SCENE)
    command = [sys.executable, "-c", LAST, "settle", "scene.toml", "--out", "out"]
    there = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=there, capture_output=True, text=True)
    assert done.returncode == 143
    told = "octoplan: terminated; shape.csv, shape.json, shape.png in out are written\n"
    assert done.stderr == told


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_commands_that_are_ended_at_any_moment_leave_all_or_nothing(
    command: str, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    codes = []
    for i in range(40):
        folder = tmp_path / str(i)
        folder.mkdir()
        number = (signal.SIGINT, signal.SIGTERM)[i % 2]
        codes.append(ended(command, number, rng.uniform(0.0, ENDS), folder))
    assert max(codes) > 0
