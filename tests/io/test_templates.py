"""What `octoplan new` writes: complete files, that the commands take as they are."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest

from planner.cli import main
from planner.commands.files import Kind


@pytest.mark.parametrize("kind", get_args(Kind))
@pytest.mark.quick("sweep", "calibrate")
def test_a_first_file_runs_as_written(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(tmp_path / "first.toml")
    assert main(["new", file, "--kind", kind]) == 0
    assert f"next: octoplan {kind} {file}" in capsys.readouterr().out
    assert "silicone = true" in (tmp_path / "first.toml").read_text()
    assert main([kind, file]) == 0
    assert main(["new", file, "--kind", kind]) == 2


def test_nothing_is_written_over_nor_half_written(tmp_path: Path) -> None:
    (tmp_path / "arm_shapes.csv").write_text("mine")
    assert main(["new", str(tmp_path / "arm.toml"), "--kind", "calibrate"]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["arm_shapes.csv"]
