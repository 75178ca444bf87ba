"""Long calls report progress: to a terminal, after a while, in one line for all."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from octoplan import calibrate, design, plan, sweep, trajectory
from octoplan.model import InputError, settle
from octoplan.model.support.progress import ProgressLine, report, track, with_progress
from octoplan.planner.frontends.cli import main

SCENES = Path(__file__).parents[3] / "studies" / "scenes"


class _Screen:
    """A stderr that is a terminal, or is not."""

    def __init__(self, tty: bool) -> None:
        self.tty, self.written = tty, ""

    def isatty(self) -> bool:
        return self.tty

    def write(self, text: str) -> int:
        self.written += text
        return len(text)

    def flush(self) -> None:
        pass

    def wait_for(self, text: str) -> None:
        while text not in self.written:
            time.sleep(0.001)

    def wait_for_times(self, phase: str, count: int) -> None:
        while len(set(re.findall(rf"{phase} \[\d+:\d+\]", self.written))) < count:
            time.sleep(0.001)


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> Any:
    def made(tty: bool, delay: float = 0.0) -> _Screen:
        found = _Screen(tty)
        monkeypatch.setattr("sys.stderr", found)
        monkeypatch.setattr("octoplan.model.support.progress.DELAY", delay)
        monkeypatch.setattr("octoplan.model.support.progress._EVERY", 0.001)
        monkeypatch.setenv("COLUMNS", "80")
        return found

    return made


@with_progress
def _long(shown: _Screen, progress: bool | None = None) -> None:
    for i in track("parts", range(3)):
        report("what is inside of a part")
        if i == 2:
            shown.wait_for("parts: 2 of 3 [00:")
    report("verifying")
    # The time goes on while a phase reports nothing more.
    shown.wait_for_times("verifying", 2)


@pytest.mark.parametrize("progress", [None, True])
def test_a_line_tells_phases_and_time_and_goes_away(screen: Any, progress: bool | None) -> None:
    shown = screen(tty=progress is None)
    _long(shown, progress=progress)
    assert "inside of a part" not in shown.written
    assert shown.written.endswith("\r")
    after = shown.written
    time.sleep(0.05)
    assert shown.written == after


@pytest.mark.parametrize(
    ("tty", "delay", "progress"), [(False, 0.0, None), (True, 99.0, None), (True, 0.0, False)]
)
def test_nothing_is_shown_where_nobody_looks_nor_soon_nor_if_unwanted(
    screen: Any, tty: bool, delay: float, progress: bool | None
) -> None:
    shown, threads = screen(tty, delay), threading.active_count()
    with ProgressLine(progress):
        report("first")
        time.sleep(0.05)
        report("second")
    assert shown.written == ""
    assert threading.active_count() == threads


def test_a_line_is_shown_on_a_terminal_that_does_not_tell_its_size(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("octoplan.model.support.progress.DELAY", 0.0)
    reader, writer = os.openpty()  # of no rows and no columns
    with os.fdopen(writer, "w") as terminal, monkeypatch.context() as patch:
        patch.setattr("sys.stderr", terminal)
        with ProgressLine():
            report("sections settled", 1, 3)
            seen = b""
            while b"sections settled: 1 of 3" not in seen:
                seen += os.read(reader, 4096)
    os.close(reader)


def test_commands_show_a_line_too(screen: Any) -> None:
    shown = screen(tty=True)
    assert main(["settle", str(SCENES / "figure_15.toml"), "--accuracy", "1e-3"]) == 0
    assert "[00:00]" in shown.written


@pytest.mark.parametrize("function", [settle, plan, trajectory, calibrate, design, sweep])
def test_all_long_calls_take_it_and_refuse_what_it_is_not(function: Any) -> None:
    with pytest.raises(InputError, match=r"None \(after 2 s"):
        function(progress="yes")


_NOTEBOOK = """
import sys, types
shell = types.SimpleNamespace(config={"IPKernelApp": {}})
sys.modules["IPython"] = types.SimpleNamespace(get_ipython=lambda: shell)
import octoplan.model.support.progress as progress, time
progress.DELAY = 0.0
with progress.ProgressLine():
    progress.report("seen in notebooks")
    time.sleep(0.2)
"""


@pytest.mark.slow
def test_a_line_is_shown_in_notebooks() -> None:
    root = Path(__file__).parents[3]
    command = [sys.executable, "-c", _NOTEBOOK]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=True)
    assert "seen in notebooks" in done.stdout
    assert done.stderr == ""
