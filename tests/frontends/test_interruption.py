"""Time limits, Ctrl-C and threads: the best so far, at once, without losses."""

from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import Buoyancy, Extension, TipLoad, Weight
from octoplan.model.support.progress import OutOfTime
from octoplan.planner import plan
from octoplan.planner.frontends import cli
from octoplan.planner.frontends.sweeps import points
from octoplan.planner.targets import TipPosition

ARM = Arm.from_paper("table-4")
TARGET = TipPosition((0.2, 0.1, 0.1))
SCENES = {
    "paper": Scene(Extension()),
    "silicone": Scene.silicone(),
    "water": Scene(Extension(), Weight(), Buoyancy(1000.0)),
    "an absurd payload": Scene(Extension(), TipLoad((0.0, 0.0, -10.0))),
}


ABSURD = pytest.param("an absurd payload", marks=pytest.mark.slow)


@pytest.mark.quick("water")
@pytest.mark.parametrize("name", ["paper", "silicone", "water", ABSURD])
def test_at_the_time_limit_there_is_a_plan_that_says_so(name: str) -> None:
    stopped = plan(ARM, TARGET, SCENES[name], 20.0, time_limit=1e-3)
    assert stopped.solution.stopped
    assert "time limit" in stopped.outcome
    assert np.all(np.isfinite(stopped.tensions)) and stopped.problem.limits.lower[0] == 0
    assert np.all((stopped.tensions >= 0) & (stopped.tensions <= 20))


@pytest.mark.slow
def test_a_plan_stopped_after_an_optimum_is_that_optimum() -> None:
    whole = plan(ARM, TARGET, SCENES["silicone"], 20.0)
    for limit in (0.3, 0.6, 1.2):
        part = plan(ARM, TARGET, SCENES["silicone"], 20.0, time_limit=limit)
        assert part.effort >= whole.effort * (1 - 1e-3) or not part.reached
    assert not whole.solution.stopped


def test_a_limit_that_is_not_reached_changes_no_digit() -> None:
    assert plan(ARM, TARGET, SCENES["paper"], 20.0, time_limit=3600.0) == plan(
        ARM, TARGET, SCENES["paper"], 20.0
    )


INTERRUPTED = """
import os, signal, sys, threading, time
from octoplan.model import Arm, Scene
from octoplan.planner import plan
from octoplan.planner.targets import TipPosition

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


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["paper", "water"])
def test_plans_are_the_same_to_the_last_digit_in_two_processes(scene: str) -> None:
    code = (
        "from tests.frontends.test_interruption import ARM, SCENES, TARGET, plan\n"
        f"found = plan(ARM, TARGET, SCENES[{scene!r}], 20.0)\n"
        "print([t.hex() for t in found.tensions.ravel()])"
    )
    run = [
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        for _ in range(2)
    ]
    assert run[0].stdout == run[1].stdout
    assert run[0].stdout.count("0x") == 12


@pytest.mark.quick("silicone")
@pytest.mark.parametrize("name", ["paper", "silicone", "water"])
def test_stopped_before_anything_was_solved_there_is_the_nearest_guess(name: str) -> None:
    """Used to be no tension at all."""
    stopped = plan(ARM, TARGET, SCENES[name], 20.0, time_limit=1e-9).certify()
    rest = settle(ARM, np.zeros(12), SCENES[name]).tip
    gap = [np.linalg.norm(tip - np.array(TARGET.position)) for tip in (stopped.shape.tip, rest)]
    assert stopped.solution.starts == ()
    assert gap[0] < 0.5 * gap[1]


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


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (["plan"], "Stopped at the time limit, the best so far."),
        (["settle"], "nothing was found within the time limit of 1e-06 s"),
        (["stiffness"], "nothing was found within the time limit"),
        (["effects"], "nothing was found within the time limit"),
        (["export", "--to", "c"], "nothing was found within the time limit"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_commands_end_at_their_time_limit(
    command: list[str],
    told: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "GRACE", 0.0)
    Path("scene.toml").write_text(SCENE)
    assert cli.main([command[0], "scene.toml", *command[1:], "--time-limit", "1e-6"]) == 1
    shown = capsys.readouterr()
    assert told in shown.out + shown.err
    assert "out of reach" not in shown.out  # An unfinished search gives no certainty.
    assert not Path("c").exists()


@pytest.mark.quick("settle")
@pytest.mark.parametrize("compute", ["settle", "plan"])
def test_a_sweep_that_is_stopped_keeps_what_is_finished(
    compute: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    axes = '[[sweep.axes]]\nkey = "arm.E_kPa"\nvalues = [90.0, 110.0]'
    file = tmp_path / "sweep.toml"
    file.write_text(f'scene = "scene.toml"\n[sweep]\ncompute = "{compute}"\n{axes}')
    in_time = iter([True])

    def looked_at() -> None:
        if not next(in_time, False):
            raise OutOfTime

    with monkeypatch.context() as changed:
        changed.setattr(points, "check_time", looked_at)
        assert cli.main(["sweep", str(file), "--time-limit", "100"]) == 1
    assert "run the sweep again" in capsys.readouterr().err
    assert len(list((tmp_path / "sweep.nc.chunks").iterdir())) == 1
    assert cli.main(["sweep", str(file)]) == 0
    assert "2 of 2 points" in capsys.readouterr().out


# A separate process: a fault of threads kills the process.
TOGETHER = """
import sys, threading, time
import numpy as np
from octoplan.model import Arm, Scene, settle
from octoplan.model.effects import Buoyancy, Extension, Weight
from octoplan.planner import plan
from octoplan.planner.targets import Backbone, TipPosition

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
    lambda k: settle(ARM, T * k, WATER).tip,
    lambda k: settle(ARM, T * k, PAPER, (1e-3, 1e-5, 1e-7, 1e-9)[k]).tip,
    lambda k: tip(k, PAPER, "auto"),
    stopped,
    lambda k: settle(ARM, T * k, Scene.as_printed()).tip,
    lambda k: tip(k, WATER),
    lambda k: tip(k, WATER, "auto"),
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


@pytest.mark.slow
def test_four_threads_plan_and_settle_what_each_does_alone() -> None:
    """Used to end the process: one memory of the solver served all threads."""
    assert "0 otherwise" in together(0.0, 3, 1, warm=False)


@pytest.mark.slow
def test_four_threads_plan_settle_and_are_stopped_for_a_minute() -> None:
    assert "0 otherwise" in together(60.0, 10, 4, warm=True)
