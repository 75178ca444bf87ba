"""The release: a wheel and an sdist that are complete, and work in an empty environment."""

from __future__ import annotations

import subprocess
import sys
import tarfile
import zipfile
from email import message_from_string
from pathlib import Path

import pytest

import octoplan
from tests.commands import ALONE, ROOT

SMOKE = """
import octoplan, shutil, tempfile
from octoplan import Arm, Extension, Scene, TipPosition, export, plan, settle
assert "site-packages" in octoplan.__file__, octoplan.__file__
arm = Arm.from_paper("table-4")
p = plan(arm, TipPosition((0.2, 0.15, -0.2)), Scene(Extension()), tension_max=20.0)
assert p.certificate.passed
if shutil.which("cc"):
    plain, fast = (settle(arm, p.tensions, p.scene, compile=how).tip for how in (False, True))
    assert (plain == fast).all()
folder = tempfile.mkdtemp()
export(arm, Scene(Extension()), folder, p.tensions)
print(octoplan.__version__)
"""


# As ALONE, without this folder, so that Python finds the installed package.
EMPTY = {name: value for name, value in ALONE.items() if name != "PYTHONPATH"}


def run(*command: str, cwd: Path | None = None) -> str:
    told = subprocess.run(command, cwd=cwd, env=EMPTY, capture_output=True, text=True)
    assert told.returncode == 0, told.stdout + told.stderr
    return told.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return the wheel and the sdist, built from a copy of the tracked files."""
    folder = tmp_path_factory.mktemp("release")
    source, out = folder / "source", folder / "dist"
    names = run("git", "-C", str(ROOT), "ls-files", "-co", "--exclude-standard").splitlines()
    for name in names:
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    run(sys.executable, "-m", "build", "--outdir", str(out), str(source))
    [wheel], [sdist] = out.glob("*.whl"), out.glob("*.tar.gz")
    return wheel, sdist


@pytest.mark.slow
def test_a_wheel_holds_what_is_not_python_too(built: tuple[Path, Path]) -> None:
    names = zipfile.ZipFile(built[0]).namelist()
    held = {name.split("/")[0] for name in names if "dist-info" not in name}
    assert held == {"octoplan"}
    kept = run("git", "-C", str(ROOT), "ls-files", "model", "planner", "octoplan").splitlines()
    there = {
        f"octoplan/{name.removeprefix('octoplan/')}" for name in kept if (ROOT / name).exists()
    }
    others = [name for name in there if not name.endswith(".py")]
    assert any(name.endswith(".c") for name in others)
    assert any(name.endswith("py.typed") for name in others)
    assert there <= set(names)
    assert any(name.endswith("licenses/LICENSE") for name in names)


@pytest.mark.slow
def test_an_sdist_holds_what_a_reader_of_it_needs(built: tuple[Path, Path]) -> None:
    with tarfile.open(built[1]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    wanted = {"LICENSE", "CITATION.cff", "CHANGELOG.md", "README.md", "docs/index.rst"}
    assert wanted | {"tests/test_release.py", "studies/README.md"} <= names


@pytest.mark.slow
def test_names_and_text_are_as_indices_want_them(built: tuple[Path, Path]) -> None:
    assert "FAILED" not in run(sys.executable, "-m", "twine", "check", "--strict", *map(str, built))
    archive = zipfile.ZipFile(built[0])
    [name] = [name for name in archive.namelist() if name.endswith("METADATA")]
    data = message_from_string(archive.read(name).decode())
    assert data["Version"] == octoplan.__version__
    assert data["License-Expression"] == "MIT"


@pytest.mark.slow
@pytest.mark.parametrize("kind", [0, 1], ids=["wheel", "sdist"])
def test_it_works_in_an_environment_of_its_own(
    built: tuple[Path, Path], kind: int, tmp_path: Path
) -> None:
    run(sys.executable, "-m", "venv", str(tmp_path / "venv"))
    python = str(tmp_path / "venv" / "bin" / "python")
    run(python, "-m", "pip", "install", "-q", str(built[kind]))
    assert run(python, "-W", "error", "-c", SMOKE, cwd=tmp_path).strip() == octoplan.__version__
    command = str(tmp_path / "venv" / "bin" / "octoplan")
    assert octoplan.__version__ in run(command, "--version", cwd=tmp_path)
    run(command, "new", "mine.toml", cwd=tmp_path)
    assert "PASSED" in run(command, "plan", "mine.toml", cwd=tmp_path)
