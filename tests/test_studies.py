"""Each study runs at a small size, prints its table and saves its figure."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from studies import (
    antagonistic_stiffness,
    bending_plane,
    calibration,
    clutter,
    design,
    effects_cost,
    fetch,
    hard_cases,
    lengths,
    maps,
    motion,
    sweeping,
    tip_targets,
    which_statics,
)

Main = Callable[[Sequence[str]], None]
SMALL: dict[str, tuple[Main, list[str], str, str]] = {
    "antagonistic_stiffness": (
        antagonistic_stiffness.main,
        ["--points", "1", "--statics", "paper's tangent"],
        "same tip, stiffer along z",
        "antagonistic_stiffness.png",
    ),
    "bending_plane": (bending_plane.main, ["--angles", "2"], "planned", "bending_plane.png"),
    "calibration": (
        calibration.main,
        ["--models", "modulus and density", "--no-leave-out"],
        "modulus and density",
        "calibration.png",
    ),
    "design": (
        design.main,
        ["--tips", "1", "--begins", "1", "--unknowns", "1"],
        "plans certified",
        "design.png",
    ),
    "effects_cost": (
        effects_cost.main,
        ["--repeats", "1", "--effects", "exact tendons", "weight in water"],
        "weight in water",
        "effects_cost.png",
    ),
    "lengths": (
        lengths.main,
        ["--plans", "1", "--draws", "1", "--every", "45", "--steps", "1", "--mixed", "1"],
        "mixed: mean",
        "lengths.png",
    ),
    "hard_cases": (
        hard_cases.main,
        ["--members", "2", "--family", "many turns", "compression, paper"],
        "from base to tip",
        "hard_cases.png",
    ),
    "maps": (
        maps.main,
        ["--draws", "50", "--pulls", "2", "--points", "2"],
        "the softest direction gives",
        "maps.png",
    ),
    "motion": (motion.main, ["--longer"], "least time over the bound 1.0", "motion.png"),
    "which_statics": (which_statics.main, [], "neo-Hookean", "which_statics.png"),
    "fetch": (
        fetch.main,
        ["--budgets", "5", "--bends", "40"],
        "least total pull",
        "fetch.png",
    ),
}


@pytest.mark.parametrize("name", SMALL)
def test_a_study_prints_its_table_and_saves_its_figure(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main, options, told, figure = SMALL[name]
    main([*options, "--out", str(tmp_path)])
    assert told in capsys.readouterr().out
    assert (tmp_path / figure).stat().st_size > 10_000


def test_the_study_of_tip_targets_compares_with_random_starts_and_scipy(
    capsys: pytest.CaptureFixture[str],
) -> None:
    tip_targets.main(["--targets", "3", "--best-of", "2", "--scipy", "1"])
    shown = capsys.readouterr().out
    assert "certified                100.0%" in shown
    assert "SLSQP" in shown


def test_the_study_of_clutter_solves_tips_among_obstacles(
    capsys: pytest.CaptureFixture[str],
) -> None:
    clutter.main(["--targets", "1", "--obstacles", "3", "--itself", "1"])
    shown = capsys.readouterr().out
    assert "solved 100.0%, wrongly 0" in shown
    assert "without a word 0" in shown


@pytest.mark.slow
def test_the_study_of_sweeping_kills_and_compares(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--plans", "10", "--kills", "1", "--settles", "500"]
    sweeping.main([*options, "--out", str(tmp_path)])
    shown = capsys.readouterr().out
    assert "killed 1 times, 10 reached: identical: True" in shown
    assert "500 settles" in shown


@pytest.mark.slow
def test_two_hundred_random_tips_are_certified_at_the_best_known_effort(
    capsys: pytest.CaptureFixture[str],
) -> None:
    tip_targets.main(["--scipy", "0", "--best-of", "20"])
    shares = {
        line.split("  ")[0]: float(line.split("%")[0].split()[-1])
        for line in capsys.readouterr().out.splitlines()
        if line.startswith(("certified", "within 1 % of the best"))
    }
    assert shares["certified"] >= 99
