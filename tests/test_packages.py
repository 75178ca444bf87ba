"""`import octoplan`, and files of users that have the names of its packages."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import octoplan

ROOT = Path(__file__).parents[1]


def ran(folder: Path, *argv: str) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder with the project on its path, as if it were installed."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, *argv]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


def test_octoplan_has_the_public_names_of_its_packages() -> None:
    import model
    import model.effects
    import model.obstacles
    import planner
    import planner.targets

    for module in (model, model.effects, model.obstacles, planner, planner.targets):
        for name in module.__all__:
            assert getattr(octoplan, name) is getattr(module, name)
            assert name in dir(octoplan)
    with pytest.raises(AttributeError, match="'octoplan' has no attribute 'Tentacle'"):
        _ = octoplan.Tentacle  # type: ignore[attr-defined]


def test_its_version_is_that_of_the_installed_package() -> None:
    from importlib.metadata import version

    assert octoplan.__version__ == version("octoplan")


def test_importing_it_loads_nothing(tmp_path: Path) -> None:
    code = "import sys, octoplan; print({'casadi', 'numpy', 'model', 'planner'} & {*sys.modules})"
    assert ran(tmp_path, "-c", code).stdout == "set()\n"


@pytest.mark.quick(
    "import octoplan; octoplan.plan-model-{}.py", "from octoplan import Arm-planner-{}/__init__.py"
)
@pytest.mark.parametrize("form", ["{}.py", "{}/__init__.py"])
@pytest.mark.parametrize("name", ["model", "planner"])
@pytest.mark.parametrize("how", ["import octoplan; octoplan.plan", "from octoplan import Arm"])
def test_a_file_of_a_package_s_name_is_told(name: str, how: str, form: str, tmp_path: Path) -> None:
    hiding = tmp_path / form.format(name)
    hiding.parent.mkdir(exist_ok=True)
    hiding.write_text("x = 1\n")
    (tmp_path / "script.py").write_text(f"{how}\n")
    told = ran(tmp_path, "script.py").stderr
    assert told.splitlines()[-1] == (
        f"ImportError: {hiding} hides octoplan's package `{name}`, because Python finds it first: "
        "rename it, or move it out of that folder"
    )


# The file that hides a package and what is in it, what is run, and its exit code.
HIDDEN = {
    "the model, from the planner": ("model.py", "x = 1", ["-c", "from planner import plan"], 1),
    "the planner, from itself": ("planner.py", "from model import Arm", ["planner.py"], 0),
    "the model, from a command": ("model.py", "x = 1", ["-m", "octoplan", "settle", "a.toml"], 2),
}


@pytest.mark.quick("the planner, from itself", "the model, from a command")
@pytest.mark.parametrize(("file", "text", "argv", "code"), HIDDEN.values(), ids=HIDDEN)
def test_whatever_is_run_says_which_file_hides_a_package(
    file: str, text: str, argv: list[str], code: int, tmp_path: Path
) -> None:
    (tmp_path / file).write_text(f"{text}\n")
    found = ran(tmp_path, *argv)
    assert (found.returncode, found.stdout) == (code, "")
    assert f"{tmp_path / file} hides octoplan's package `{file[:-3]}`" in found.stderr
    assert "Traceback" not in found.stderr or code == 1


@pytest.mark.slow
def test_a_folder_that_is_no_package_hides_nothing(tmp_path: Path) -> None:
    (tmp_path / "model").mkdir()
    (tmp_path / "planner").mkdir()
    (tmp_path / "script.py").write_text("from octoplan import Arm, plan\n")
    found = ran(tmp_path, "script.py")
    assert (found.returncode, found.stderr) == (0, "")


def test_a_name_that_is_nearly_one_is_suggested() -> None:
    with pytest.raises(AttributeError, match="'TipPostion'; did you mean 'TipPosition'"):
        octoplan.TipPostion  # noqa: B018
    with pytest.raises(AttributeError, match=r"no attribute 'nothing_like_it'$"):
        octoplan.nothing_like_it  # noqa: B018
    # Python drops what an AttributeError advises.
    with pytest.raises(ImportError, match="'Extention' from 'octoplan'; did you mean 'Extension'"):
        from octoplan import Extention  # type: ignore[attr-defined]  # noqa: F401


def test_warnings_point_at_the_line_of_the_caller() -> None:
    arm = octoplan.Arm.from_paper("table-4")
    with pytest.warns(octoplan.UnitWarning) as told:
        octoplan.settle(arm, lengths=[1e3] * 12)
    assert {own.filename for own in told} == {__file__}


def test_a_shape_is_drawn_where_nothing_but_the_mechanics_was_loaded(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(
        "import sys\nfrom octoplan import Arm, settle\n"
        "shape = settle(Arm.from_paper('table-4'), [0.0] * 12)\n"
        "assert 'planner' not in sys.modules\n"
        "assert 'png' in shape._repr_html_()\nprint(type(shape.plot()).__name__)\n"
    )
    found = ran(tmp_path, "script.py")
    assert (found.stdout, found.stderr) == ("Figure\n", "")
