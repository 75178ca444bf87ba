"""Each study runs at a small size, prints its table and saves its figures."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.commands import ALONE, ROOT, study

SMALL: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "antagonistic_stiffness": (
        "--points 1 --statics paper's_tangent",
        "same tip, stiffer along z",
        ("antagonistic_stiffness.png",),
    ),
    "bending_plane": ("--angles 2", "standard deviation", ("bending_plane.png",)),
    "calibration": (
        "--models modulus_and_density --no-leave-out",
        "modulus and density",
        ("calibration.png",),
    ),
    "clutter": ("--targets 1 --obstacles 3 --itself 1", "solved 100.0%, wrongly 0", ()),
    "design": ("--tips 1 --begins 1 --unknowns 2 --search 1", "plans certified", ("design.png",)),
    "fetch": ("--budgets 5 --bends 40", "least total pull", ("fetch.png",)),
    "grasp": ("--radii 40 --ends 0 --shares 0.05", "1 of 1 wraps", ("grasp.png",)),
    "grip": (
        "--angles 90 --ratios 0.95 0.6",
        "90 degrees, friction 0.3: grip",
        ("grip.png",),
    ),
    "hard_cases": ("--members 1 --family many_turns", "from base to tip", ("hard_cases.png",)),
    "lengths": (
        "--plans 1 --draws 1 --every 45 --steps 1 --mixed 2 --several 2",
        "mixed: mean",
        ("lengths.png",),
    ),
    "maps": (
        "--draws 20 --pulls 1 --points 1",
        "the softest direction gives",
        ("maps.png",),
    ),
    "motion": ("--longer --waypoints 3", "least time over the lower bound 1.00", ("motion.png",)),
    "planner_suite": (
        "--targets 3 --best-of 0 --jobs 1",
        "all                3   100.0%      0      100.0%",
        (),
    ),
    "recovery": ("--arms 1 --cases 1", "intervals contain the truth", ()),
    "solvers": ("--targets 1 --guesses 1 --scenes paper", "multiple shooting, ipopt", ()),
    "speed accuracy": (
        "--cases 1 --repeats 1 --finest 1 --settings 1",
        "settle's choice",
        ("accuracy_cost.png", "accuracy_cost_scenes.png", "accuracy_cost_silicone.png"),
    ),
    "speed effects": (
        "--repeats 1 --effects exact_tendons weight_in_water",
        "weight in water",
        ("effects_cost.png",),
    ),
    "speed fit": ("--repeats 1 --shapes 4 --interpreted", "times as fast; modulus", ()),
    "speed follow": ("--steps 6", "0 refused with a reason, 0 without", ()),
    "speed knob": ("--cases 13", "error within the requested accuracy   100.0%", ()),
    "speed plan": (
        "--rows path scenes sections --plans 1 --points 2 --arms 1 --sections 1 2",
        "plans along 2 points, warm",
        (),
    ),
    "speed settle": (
        "--repeats 1 --arms 1 --batch 4 --sections 1 2 --rows settle jacobian sections",
        "tip Jacobian, 12 tensions, compiled",
        (),
    ),
    "speed sweep": ("--plans 10 --settles 500", "identical: True", ()),
    "planner_suite --beyond": ("--targets 1 --best-of 8 --jobs 1", "100.0%    1.000", ()),
    "verification": ("--members 1 --rows weight helical", "heavy elastica by shooting", ()),
    "which_statics": ("", "neo-Hookean", ("which_statics.png",)),
}


@pytest.mark.quick("which_statics")
@pytest.mark.parametrize("name", SMALL)
def test_a_study_prints_its_table_and_saves_its_figures(name: str, tmp_path: Path) -> None:
    options, told, figures = SMALL[name]
    words = [word.replace("_", " ") for word in options.split()]
    folder = ["--out", str(tmp_path)] * bool(figures)
    shown = study(name, *words, *folder)
    assert told in shown
    for figure in figures:
        assert (tmp_path / figure).stat().st_size > 10_000


@pytest.mark.slow
def test_what_the_planner_suite_keeps_of_a_case_ends_as_the_case_did() -> None:
    script = study("planner_suite", "--case", "1", "--seed", "3", "--best-of", "0")
    told = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, env=ALONE, capture_output=True, text=True
    )
    assert told.stdout.splitlines() == [
        next(own[2:] for own in script.splitlines() if own.startswith("# "))
    ]


@pytest.mark.slow
def test_what_was_finished_at_ctrl_c_is_told_and_drawn(tmp_path: Path) -> None:
    command = [sys.executable, "-u", "-m", "studies.hard_cases", "--members", "3", "--out"]
    family = ["--family", "many turns", "ill-posed plans"]
    running = subprocess.Popen(
        [*command, tmp_path, *family],
        cwd=ROOT,
        env=ALONE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert running.stdout is not None
    while "many turns" not in running.stdout.readline():
        assert running.poll() is None
    os.kill(running.pid, signal.SIGINT)
    out, err = running.communicate()
    assert "interrupted" in err
    assert "from base to tip" in out
    assert (tmp_path / "hard_cases.png").stat().st_size > 0


@pytest.mark.slow
def test_two_hundred_random_tips_are_certified_and_none_wrongly() -> None:
    shown = study("planner_suite", "--kinds", "tip", "--targets", "200", "--best-of", "0")
    (total,) = (line.split() for line in shown.splitlines() if line.startswith("all"))
    assert total[1:4:2] == ["200", "0"]
    assert float(total[2].rstrip("%")) >= 99
