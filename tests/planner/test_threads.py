"""Threads: what they plan and settle together is what each finds alone, and the process lives."""

from __future__ import annotations

import subprocess
import sys

import pytest

# A process of its own: what threads break kills it.
TOGETHER = """
import sys, threading, time
import numpy as np
from model import Arm, Scene, settle
from model.effects import Buoyancy, Extension, Weight
from planner import plan
from planner.targets import Backbone, TipPosition

ARM, T = Arm.from_paper("table-4"), np.linspace(0, 1, 12)
PAPER, WATER = Scene(Extension()), Scene(Extension(), Weight(), Buoyancy(1000.0))
SECONDS, N = {seconds}, {each}

def tip(k, scene, how=False):
    target = TipPosition((0.2 + 0.02 * k, 0.1, -0.1))
    return plan(ARM, target, scene, 20.0, compile=how).tensions

def stopped(k):
    target = TipPosition((0.2, 0.1, 0.1 + 0.01 * k))
    found = plan(ARM, target, Scene.silicone(), 20.0, time_limit=0.2)
    assert found.outcome
    return found.tensions * 0

def backbone(k):
    points = settle(ARM, T * (1 + k / 4), PAPER).position(np.array([0.2, 0.4]))
    return plan(ARM, Backbone(points.tolist()), PAPER, 20.0).tensions

JOBS = [
    lambda k: tip(k, PAPER),
    lambda k: tip(k, PAPER, "auto"),
    stopped,
    lambda k: settle(ARM, T * k, WATER).tip,
    lambda k: settle(ARM, T * k, PAPER, scheme=("magnus6", "gauss6", "magnus4", "gauss4")[k]).tip,
    lambda k: settle(ARM, T * k, Scene.as_printed()).tip,
    lambda k: tip(k, WATER),
    lambda k: tip(k, WATER, "auto"),
    lambda k: tip(k, Scene.as_printed()),
    lambda k: tip(k, Scene.silicone()),
    backbone,
][:{jobs}]
ALONE = {{(j, k): job(k) for j, job in enumerate(JOBS) for k in range(N)}} if {warm} else {{}}
count, wrong = [], []

def work(i):
    rng, end = np.random.default_rng(i), time.monotonic() + SECONDS
    todo = [(j, k) for j in range(len(JOBS)) for k in range(N)]
    while True:
        for j, k in rng.permutation(todo).tolist():
            try:
                found = JOBS[j](k)
                same = np.allclose(ALONE.setdefault((j, k), found), found, rtol=1e-9, atol=1e-9)
            except Exception as reason:
                same = repr(reason)
            count.append(j)
            if same is not True:
                wrong.append((j, k, same))
        if time.monotonic() > end:
            return

before = sys.stderr
threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
assert sys.stderr is before
print(len(count), "done,", len(wrong), "otherwise", wrong[:3])
"""


def together(seconds: float, jobs: int, each: int, warm: bool) -> str:
    code = TOGETHER.format(seconds=seconds, jobs=jobs, each=each, warm=warm)
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, f"exit code {run.returncode}: {run.stderr[-3000:]}"
    return run.stdout


def test_four_threads_plan_and_settle_what_each_does_alone() -> None:
    """Used to end the process: one memory of the solver served all threads."""
    assert "0 otherwise" in together(0.0, 5, 1, warm=False)


@pytest.mark.slow
def test_four_threads_plan_settle_and_are_stopped_for_a_minute() -> None:
    assert "0 otherwise" in together(60.0, 11, 4, warm=True)
