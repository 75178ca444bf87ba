"""`import octoplan`: names, loading of packages, and files that could hide packages."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import octoplan
from octoplan.model.support.units import UnitWarning

ROOT = Path(__file__).parents[1]


def ran(folder: Path, *argv: str) -> subprocess.CompletedProcess[str]:
    """Run Python in a folder with the project on its path, as if it were installed."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, *argv]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


def test_octoplan_has_the_public_names_of_its_packages() -> None:
    import octoplan.model
    import octoplan.model.effects
    import octoplan.model.extensions.contact
    import octoplan.model.extensions.obstacles
    import octoplan.planner
    import octoplan.planner.targets

    for module in (
        octoplan.model,
        octoplan.model.effects,
        octoplan.model.extensions.contact,
        octoplan.model.extensions.obstacles,
        octoplan.planner,
        octoplan.planner.targets,
    ):
        for name in module.__all__:
            assert getattr(octoplan, name) is getattr(module, name)
            assert name in dir(octoplan)
    with pytest.raises(AttributeError, match="'octoplan' has no attribute 'Tentacle'"):
        _ = octoplan.Tentacle  # type: ignore[attr-defined]


def test_its_version_is_that_of_the_installed_package() -> None:
    from importlib.metadata import version

    assert octoplan.__version__ == version("octoplan")


def test_importing_it_loads_nothing(tmp_path: Path) -> None:
    code = "import sys, octoplan; print({'casadi', 'numpy', 'octoplan.model'} & {*sys.modules})"
    assert ran(tmp_path, "-c", code).stdout == "set()\n"


def test_packages_load_when_they_are_named(tmp_path: Path) -> None:
    code = "import sys, octoplan; octoplan.model.Arm; print('octoplan.planner' in sys.modules)"
    assert ran(tmp_path, "-c", code).stdout == "False\n"


def test_files_of_the_user_do_not_hide_its_packages(tmp_path: Path) -> None:
    for name in ("model", "planner"):
        (tmp_path / f"{name}.py").write_text("raise RuntimeError\n")
    (tmp_path / "script.py").write_text("from octoplan import Arm, Weight, plan, trajectory\n")
    found = ran(tmp_path, "script.py")
    assert (found.returncode, found.stderr) == (0, "")


def test_a_name_that_is_nearly_one_is_suggested() -> None:
    with pytest.raises(AttributeError, match="'TipPostion'; did you mean 'TipPosition'"):
        octoplan.TipPostion  # noqa: B018
    with pytest.raises(AttributeError, match=r"no attribute 'nothing_like_it'$"):
        octoplan.nothing_like_it  # noqa: B018
    # Python omits the message of an AttributeError.
    with pytest.raises(ImportError, match="'Extention' from 'octoplan'; did you mean 'Extension'"):
        from octoplan import Extention  # type: ignore[attr-defined]  # noqa: F401


def test_warnings_point_at_the_line_of_the_caller() -> None:
    arm = octoplan.Arm.from_paper("table-4")
    with pytest.warns(UnitWarning) as told:
        octoplan.settle(arm, lengths=[1e3] * 12)
    assert {own.filename for own in told} == {__file__}


def test_a_shape_is_drawn_where_nothing_but_the_mechanics_was_loaded(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(
        "import sys\nfrom octoplan import Arm, settle\n"
        "shape = settle(Arm.from_paper('table-4'), [0.0] * 12)\n"
        "assert 'octoplan.planner' not in sys.modules\n"
        "assert 'png' in shape._repr_html_()\nprint(type(shape.plot()).__name__)\n"
    )
    found = ran(tmp_path, "script.py")
    assert (found.stdout, found.stderr) == ("Figure\n", "")
