"""The documentation builds without a warning, its examples run, and all names are documented."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import octoplan
from octoplan.command_line import COMMANDS as OWN
from octoplan.planner.frontends.cli import parse
from tests.commands import ALONE, ROOT, source

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PAGES = {str(path.relative_to(ROOT)): path.read_text() for path in ROOT.glob("docs/**/*.rst")}
TEXT = "\n".join([*PAGES.values(), (ROOT / "studies" / "README.md").read_text()])
_LINES = [*re.findall(r"^ +\$ (.+)$", TEXT, re.MULTILINE), *re.findall(r"``?([^`]+)``?", TEXT)]
_NAMED = r"octoplan [a-z]+|python -m studies\."
COMMANDS = sorted({" ".join(own.split()) for own in _LINES if re.match(_NAMED, own)})


def _sphinx(builder: str, folder: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", builder]
    folders = ["-d", str(folder / "doctrees"), str(ROOT / "docs"), str(folder / builder)]
    told = subprocess.run([*command, *folders], cwd=ROOT, env=ALONE, capture_output=True, text=True)
    assert told.returncode == 0, told.stdout + told.stderr


@pytest.mark.slow
def test_documentation_builds_without_a_warning_and_its_examples_run(tmp_path: Path) -> None:
    """Both builders use the same pages: the doctest builder does not run the notebook again."""
    pytest.importorskip("sphinx", reason="python -m pip install 'octoplan[docs]' builds it")
    _sphinx("html", tmp_path)
    keys = (tmp_path / "html" / "scene_files.html").read_text()
    assert all(key in keys for key in ("tension_max", "E_kPa", "position_mm", "rate_max"))
    assert "PASSED" in (tmp_path / "html" / "examples" / "first_plan.html").read_text()
    _sphinx("doctest", tmp_path)


@pytest.mark.quick("around_a_ball")
@pytest.mark.parametrize("path", sorted(ROOT.glob("docs/examples/*.py")), ids=lambda own: own.stem)
def test_an_example_runs_and_leaves_its_figure(path: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-W", "error", str(path), str(tmp_path)]
    told = subprocess.run(command, cwd=ROOT, env=ALONE, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    assert "Reached" in told.stdout
    assert (tmp_path / f"{path.stem}.png").stat().st_size > 10_000


def test_every_public_name_is_looked_up_somewhere() -> None:
    pages = "\n".join(text for name, text in PAGES.items() if "/api/" in name)
    named = set(re.findall(r":: octoplan\.(?!model\.|planner\.)(\w+)", pages))
    errors = {name for name in octoplan.__all__ if name.endswith("Error")}
    assert set(octoplan.__all__) - errors <= named
    assert named <= set(octoplan.__all__)


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_that_are_named_are_there(command: str) -> None:
    words = shlex.split(command.partition(" >")[0])
    if words[0] == "octoplan":
        assert words[1] in OWN
        if len(words) > 2:
            parse(words[1:])
    else:
        text = source(command.partition(" >")[0])
        assert not [own for own in words[3:] if own.startswith("--") and f'"{own}"' not in text]
    files = [own for own in words if own.startswith(("studies/", "docs/"))]
    assert not [own for own in files if not (ROOT / own).exists()]


def test_the_citation_names_this_version_and_license() -> None:
    lines = (ROOT / "CITATION.cff").read_text().splitlines()
    assert f"version: {PROJECT['version']}" in lines
    assert f"license: {PROJECT['license']}" in lines
    assert (ROOT / "LICENSE").read_text().startswith("MIT License")
