"""README.md: its commands run, its scripts run, its files exist."""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import matplotlib as mpl
import pytest

from tests.commands import source

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text()
SCRIPTS = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
_PROSE = re.sub(r"^```.*?^```", "", TEXT, flags=re.MULTILINE | re.DOTALL)
_LINES = [*re.findall(r"^    (\S.*)$", _PROSE, re.MULTILINE), *re.findall(r"`([^`\n]+)`", _PROSE)]
COMMANDS = [part.strip() for line in _LINES for part in line.split("&&")]
STUDIES = sorted({own for own in COMMANDS if own.startswith("python -m studies.")})
INSTALLS = [own for own in COMMANDS if own.startswith("python -m pip install")]
# Whole commands; `octoplan plan` and the like, in the middle of a sentence, only name one.
RUNS = [own for own in COMMANDS if re.match(r"octoplan \w+ (?!SCENE)\S|sphinx-build", own)]
QUICK = ("octoplan plan", "octoplan new")


def test_the_readme_has_commands_and_scripts_of_each_kind() -> None:
    assert COMMANDS[:2] == INSTALLS[:1] + RUNS[:1]
    assert len(SCRIPTS) == 1
    assert len(STUDIES) >= 4
    assert {own.split()[1] for own in RUNS if own.startswith("octoplan")} == {"plan", "new"}


def _run(command: str, folder: Path) -> None:
    """Run a command of the README in a folder with the project's files."""
    for name in ("studies", "docs"):
        if not (folder / name).exists():
            (folder / name).symlink_to(ROOT / name)
    command, _, target = command.partition(" > ")
    words = shlex.split(command)
    programs = {"octoplan": "octoplan", "sphinx-build": "sphinx"}
    if words[0] in programs:
        words = [sys.executable, "-m", programs[words[0]], *words[1:]]
    alone = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    told = subprocess.run(words, cwd=folder, env=alone, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    if target:
        (folder / target).write_text(told.stdout)


def test_the_quick_commands_run(tmp_path: Path) -> None:
    quick = [own for own in RUNS if own.startswith(QUICK)]
    for command in quick:
        _run(command, tmp_path)
    assert len(quick) == 2
    assert (tmp_path / "out" / "plan.png").stat().st_size > 10_000
    assert (tmp_path / "scene.toml").is_file()


@pytest.mark.parametrize("command", STUDIES)
def test_the_studies_take_the_options_that_are_given(command: str) -> None:
    text, options = source(command), shlex.split(command)[3:]
    assert not [own for own in options if own.startswith("-") and f'"{own}"' not in text]


def test_the_extras_that_are_installed_are_there() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    named = {own for command in COMMANDS for own in re.findall(r"\.\[(\w+)\]", command)}
    assert {"test", "docs"} <= named
    assert named <= set(project["optional-dependencies"])


def test_the_script_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    mpl.use("Agg")
    assert len(SCRIPTS[0].splitlines()) <= 20
    exec(SCRIPTS[0], {})
    assert "Reached" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"plan.png", "plan.json"}


def test_a_number_of_the_results_is_that_of_its_study() -> None:
    """Numbers of a benchmark are in studies/README.md; the README has the same digits."""
    answers = (ROOT / "studies" / "README.md").read_text()
    rows = [line for line in TEXT.splitlines() if "python -m studies." in line and line[0] == "|"]
    assert len(rows) >= 4
    for row in rows:
        _, said, _, command = (cell.strip() for cell in row.strip("|").split("|"))
        study = command.strip("`").partition(" --")[0].removeprefix("python -m studies.")
        answer = answers.partition(f"\n**{study}.**")[2].partition("\n\n**")[0]
        assert answer, study
        digits = re.findall(r"\d+(?:\.\d+)?", said)
        assert digits
        assert not [own for own in digits if not re.search(rf"(?<![\d.]){own}(?![\d.]*\d)", answer)]


def test_what_the_readme_points_at_is_there() -> None:
    places = re.findall(r"\]\(((?!http)[^)]+)\)", TEXT)
    files = re.findall(r"`((?:studies|tests|docs)/[\w/.-]+|\w+\.(?:md|cff))`", TEXT)
    assert places
    assert not [own for own in (*places, *files) if not (ROOT / own).exists()]
