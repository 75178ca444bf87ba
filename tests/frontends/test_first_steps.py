"""First steps on the command line: written files, stability, help, exit codes and templates."""

from __future__ import annotations

import json
import re
from pathlib import Path

import msgspec
import pytest

from octoplan.command_line import _DETAILS, COMMANDS, EXIT_CODES
from octoplan.planner.frontends.cli import _CODES, main
from octoplan.planner.frontends.commands.files import TEMPLATES
from octoplan.planner.frontends.io.scene_tables import StiffnessTable

DOCS = Path(__file__).parents[2] / "docs"
ARM = 'accuracy = 1e-4\n[arm]\npreset = "section-5.2"\n'
TENSIONS = "tensions = [0.0, 0.3, 0.0, 0.0]\n"
WATER = "[effects]\nsilicone = true\nweight = {}\nbuoyancy = {}\n"


def run(*words: object) -> int:
    return main(list(map(str, words)))


def test_the_first_command_names_the_files_that_it_wrote(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.toml"
    assert run("new", scene) == 0
    assert run("plan", scene, "--out", tmp_path / "out") == 0
    last = capsys.readouterr().out.rstrip().splitlines()[-1]
    folder, names = re.fullmatch(r"written to (.*): (.*)", last).groups()  # type: ignore[union-attr]
    assert Path(folder) == tmp_path / "out"
    written = sorted(each.name for each in (tmp_path / "out").iterdir())
    assert sorted(names.split(", ")) == written
    assert written == ["plan.csv", "plan.json", "plan.png", "shape.csv"]


@pytest.fixture
def settled(tmp_path: Path) -> Path:
    scene = tmp_path / "scene.toml"
    scene.write_text(TENSIONS + ARM + WATER)
    return scene


def test_json_output_stays_json_with_files(
    settled: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("settle", settled, "--json", "--out", tmp_path / "out") == 0
    out = capsys.readouterr().out
    assert out == (tmp_path / "out" / "shape.json").read_text().rstrip("\n") + "\n"


def test_settle_prints_the_stability_under_loads(
    settled: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("settle", settled) == 0
    line = capsys.readouterr().out.rstrip().splitlines()[-1]
    assert line.startswith("stability under the loads [-]")
    assert line.endswith(": stable; 1 at rest, 0 at buckling")
    assert run("settle", settled, "--json") == 0
    value = json.loads(capsys.readouterr().out)["stability"]
    assert f"{value:.3g}:" in line
    assert 0 < value < 1


def test_settle_prints_no_stability_without_loads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(TENSIONS + ARM)
    assert run("settle", scene) == 0
    assert "stability" not in capsys.readouterr().out
    assert run("settle", scene, "--json") == 0
    assert json.loads(capsys.readouterr().out)["stability"] is None


def test_the_help_of_stiffness_names_the_keys_of_its_table(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run("stiffness", "--help") == 0
    shown = capsys.readouterr().out
    keys = re.findall(r"^  (\w+)  ", _DETAILS["stiffness"], re.MULTILINE)
    assert keys == [field.name for field in msgspec.structs.fields(StiffnessTable)]
    assert all(line in shown for line in _DETAILS["stiffness"].splitlines())


def test_the_list_of_commands_has_one_sentence_each(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--help") == 0
    assert "tendon_EA" not in capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_of_each_command_ends_with_the_exit_codes(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(command, "--help") == 0
    assert capsys.readouterr().out.rstrip().endswith(EXIT_CODES.rstrip())


def test_the_documentation_includes_the_exit_codes_of_the_help() -> None:
    page = (DOCS / "command_line.rst").read_text()
    assert ".. literalinclude:: ../octoplan/command_line.py" in page
    source = (DOCS.parent / "octoplan" / "command_line.py").read_text()
    shown = source.split("Exit codes:", 1)[1].split('"""', 1)[0]
    assert shown.strip() == EXIT_CODES.split("Exit codes:", 1)[1].strip()
    assert "141" not in page


def test_the_documentation_describes_every_command() -> None:
    page = (DOCS / "command_line.rst").read_text()
    assert set(re.findall(r"^``octoplan (\w+)`` ", page, re.MULTILINE)) == {*COMMANDS}


def test_the_help_lists_the_exit_codes_of_all_errors() -> None:
    listed = set(map(int, re.findall(r"\b\d+\b", EXIT_CODES)))
    assert listed == {0, 130, 143, *(code for _, code in _CODES)}


@pytest.mark.slow
def test_the_trajectory_template_is_quasi_static(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "trajectory.toml"
    assert run("new", scene, "--kind", "trajectory") == 0
    assert run("trajectory", scene) == 0
    assert "Slow enough to be quasi-static: the tip accelerates by" in capsys.readouterr().out


def test_the_trajectory_template_says_that_it_is_quasi_static() -> None:
    text = (TEMPLATES / "trajectory.toml").read_text()
    assert text.splitlines()[1].startswith("# A quasi-static trajectory")
    assert re.search(r"^quasi_static = true ", text, re.MULTILINE)
