"""Docstrings become a site without a warning; citation and license say what the package does."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.mark.slow
def test_the_documentation_builds_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("sphinx", reason="python -m pip install 'octoplan[docs]' builds it")
    site = tmp_path / "site"
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going"]
    folders = ["-d", str(tmp_path / "doctrees"), str(ROOT / "docs"), str(site)]
    told = subprocess.run([*command, *folders], cwd=ROOT, capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    pages = {page.name: page.read_text() for page in site.glob("*.html")}
    assert "planner.plan" in pages["planner.html"]
    assert "tip_load" in pages["command_line.html"]
    assert all(
        name in pages["model.html"] for name in ("settle_many", "tip_jacobian", "from_paper")
    )


def test_the_citation_names_this_version_and_license() -> None:
    lines = (ROOT / "CITATION.cff").read_text().splitlines()
    assert f"version: {PROJECT['version']}" in lines
    assert f"license: {PROJECT['license']}" in lines
    assert (ROOT / "LICENSE").read_text().startswith("MIT License")
