"""Time limits and Ctrl-C: the best so far, at once, and nothing lost."""

from __future__ import annotations

import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from model import Arm, InputError, Scene
from model.effects import Buoyancy, Extension, TipLoad, Weight
from planner import plan
from planner.targets import TipPosition

ARM = Arm.from_paper("table-4")
TARGET = TipPosition((0.2, 0.1, 0.1))
SCENES = {
    "paper": Scene(Extension()),
    "silicone": Scene.silicone(),
    "water": Scene(Extension(), Weight(), Buoyancy(1000.0)),
    "an absurd payload": Scene(Extension(), TipLoad((0.0, 0.0, -10.0))),
}


ABSURD = pytest.param("an absurd payload", marks=pytest.mark.slow)


@pytest.mark.parametrize("name", ["paper", "silicone", "water", ABSURD])
def test_at_the_time_limit_there_is_a_plan_that_says_so(name: str) -> None:
    stopped = plan(ARM, TARGET, SCENES[name], 20.0, time_limit=1e-3)
    assert stopped.stopped
    assert "time limit" in stopped.outcome
    assert np.all(np.isfinite(stopped.tensions)) and stopped.limits.lower[0] == 0
    assert np.all((stopped.tensions >= 0) & (stopped.tensions <= 20))


def test_a_plan_stopped_after_an_optimum_is_that_optimum() -> None:
    whole = plan(ARM, TARGET, SCENES["silicone"], 20.0)
    for limit in (0.3, 0.6, 1.2):
        part = plan(ARM, TARGET, SCENES["silicone"], 20.0, time_limit=limit)
        assert part.effort >= whole.effort * (1 - 1e-3) or not part.reached
    assert not whole.stopped


def test_a_limit_that_is_not_reached_changes_no_digit() -> None:
    assert plan(ARM, TARGET, SCENES["paper"], 20.0, time_limit=3600.0) == plan(
        ARM, TARGET, SCENES["paper"], 20.0
    )


@pytest.mark.parametrize("limit", [0, -1.0, float("nan"), float("inf"), "soon", True])
def test_time_limits_that_are_none_are_refused(limit: object) -> None:
    with pytest.raises(InputError, match="time_limit"):
        plan(ARM, TARGET, SCENES["paper"], 20.0, time_limit=limit)  # type: ignore[arg-type]


INTERRUPTED = """
import os, signal, sys, threading, time
from model import Arm, Scene
from planner import plan
from planner.targets import TipPosition

arm, target, scene = Arm.from_paper("table-4"), TipPosition((0.2, 0.1, 0.1)), Scene.silicone()
first = plan(arm, target, scene, 20.0)
threading.Timer({delay}, os.kill, (os.getpid(), signal.SIGINT)).start()
plans = 0
try:
    while True:
        assert plan(arm, target, scene, 20.0) == first
        plans += 1
except KeyboardInterrupt:
    again = plan(arm, target, scene, 20.0)
    print("interrupted", again == first)
"""


@pytest.mark.parametrize("delay", [0.2, pytest.param(0.9, marks=pytest.mark.slow)])
def test_ctrl_c_ends_a_plan_and_leaves_the_next_one_alone(delay: float) -> None:
    code = textwrap.dedent(INTERRUPTED.format(delay=delay))
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert done.stdout.strip() == "interrupted True", done.stderr[-2000:]


def test_plans_are_the_same_to_the_last_digit_in_two_processes() -> None:
    code = (
        "from tests.planner.test_interruption import ARM, SCENES, TARGET, plan\n"
        "for scene in ('paper', 'water'):\n"
        "    print([t.hex() for t in plan(ARM, TARGET, SCENES[scene], 20.0).tensions.ravel()])"
    )
    run = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert run[0].stdout == run[1].stdout
    assert len(run[0].stdout.splitlines()) == 2
