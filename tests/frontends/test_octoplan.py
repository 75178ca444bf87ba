"""octoplan as a program: JSON by its schema, files, exit codes, interruptions, progress."""

from __future__ import annotations

import errno
import json
import os
import shlex
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from octoplan.command_line import COMMANDS
from octoplan.model import settle
from octoplan.planner import load_plan, stiffness
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.commands.files import TEMPLATES, schema_of
from octoplan.planner.frontends.io.scene_file import load, read

TEMPLATE = (TEMPLATES / "plan.toml").read_text()

ROOT = Path(__file__).parents[2]
SCENES = ROOT / "studies" / "scenes"
BENDING, FIGURE_15 = str(SCENES / "bending_135.toml"), str(SCENES / "figure_15.toml")
LONG = str(SCENES / "payload_in_water.toml")
CALM = (
    "accuracy = 1e-4\ntensions = [[0.3, 0.2, 0.0, 0.1]]\n[arm]\npreset = 'section-5.2'\n"
    "[effects]\nextension = true\n[stiffness]\nhold = 'length'\nat_mm = 135\n"
)


@pytest.fixture
def calm(tmp_path: Path) -> str:
    path = tmp_path / "calm.toml"
    path.write_text(CALM)
    return str(path)


def _json(capsys: pytest.CaptureFixture[str], *argv: str) -> Any:
    assert main([*argv, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.quick("stiffness", "settle")
@pytest.mark.parametrize("command", ["settle", "stiffness", "effects"])
def test_json_is_as_its_schema_says(
    command: str, calm: str, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = _json(capsys, command, calm)
    assert main(["schema", command]) == 0
    schema = json.loads(capsys.readouterr().out)
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(shown, schema)
    top = schema["$defs"][schema["$ref"].rpartition("/")[2]]
    assert set(shown) == set(top["required"])


def test_stiffness_is_that_of_a_script(
    tmp_path: Path, calm: str, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = _json(capsys, "stiffness", calm, "--out", str(tmp_path / "out"))
    q = read(CALM.encode())
    k = stiffness(q.arm, q.tensions, q.scene, "length", 0.135, accuracy=1e-4)
    assert np.array_equal(shown["compliance"], k.compliance)
    assert np.array_equal(shown["section_N_m2"], k.section(np.array(shown["s_m"])))
    assert shown["hold"] == "length"
    assert shown["slack"] == ["T_13"]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"stiffness.json", "stiffness.png"}


def test_a_new_scene_is_planned_at_once_and_never_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "my own.toml"
    assert main(["new", str(path)]) == 0
    command = capsys.readouterr().out.partition("next: octoplan ")[2]
    assert shlex.split(command)[:2] == ["plan", str(path)]
    assert main(["plan", str(path)]) == 0
    assert "PASSED" in capsys.readouterr().out
    path.write_text("# mine")
    assert main(["new", str(path)]) == 2
    assert "does not exist yet" in capsys.readouterr().err
    assert path.read_text() == "# mine"
    assert main(["new", str(tmp_path / "mine.json")]) == 2
    assert main(["new", str(tmp_path / "nowhere" / "mine.toml")]) == 2
    assert [p.name for p in tmp_path.iterdir()] == ["my own.toml"]


def test_a_new_scene_shows_every_key_and_is_valid() -> None:
    jsonschema.validate(tomllib.loads(TEMPLATE), json.loads(json.dumps(schema_of("scene"))))
    tables = [table["properties"] for table in schema_of("scene")["$defs"].values()]
    keys = set().union(*tables) - {"targets", "matrix", "sections"}
    words = {
        line.strip("# ") for line in TEMPLATE.replace("{", "\n").replace(",", "\n").split("\n")
    }
    assigned = {word.partition("=")[0].strip() for word in words if "=" in word}
    headings = {word.strip("[] ").partition("]")[0] for word in words if word.startswith("[")}
    assert keys - assigned - headings == set()


def test_each_switched_off_line_of_a_new_scene_is_one_that_can_be_switched_on() -> None:
    alone = {"exact_tendons", "shear", "weight", "tip_load", "point_loads", "current", "friction"}
    alone |= {"norm", "base", "hull_mm", "base_position_mm", "base_frame", "tension_min"}
    alone |= {"total_pull", "at_mm", "cross_section", "line_loads"}
    for key in sorted(alone):
        assert f"# {key} = " in TEMPLATE
        read(TEMPLATE.replace(f"# {key} = ", f"{key} = ").encode())


@pytest.mark.parametrize("command", COMMANDS)
def test_help_tells_the_exit_codes(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0
    assert "130  interrupted" in capsys.readouterr().out


def _octoplan(*argv: str, **options: Any) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-u", "-m", "octoplan", *argv],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=options.get("stderr", subprocess.PIPE),
        text=True,
    )


@pytest.mark.slow
def test_a_reader_that_goes_away_ends_it_quietly() -> None:
    process = _octoplan("settle", FIGURE_15, "--json")
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait() == 141
    process.stderr.close()


@pytest.mark.slow
def test_an_interrupt_ends_it_quietly_in_the_midst_of_the_solver() -> None:
    process = _octoplan("plan", LONG, "-v")
    assert process.stderr is not None
    assert process.stdout is not None
    assert any(line.startswith("octoplan.planner.solve.ipopt: ") for line in process.stderr)
    process.send_signal(signal.SIGINT)
    shown, told = process.communicate()
    assert process.returncode == 130
    assert shown == ""
    assert "Traceback" not in told
    assert "KeyboardInterrupt" not in told


def test_the_solver_speaks_on_stderr_if_asked_and_stdout_is_json(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["plan", BENDING, "--json", "-v"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["certified"]
    assert "octoplan.planner.solve.ipopt: converged after" in captured.err
    assert "octoplan.model.support.progress: verifying" in captured.err
    assert main(["plan", BENDING, "--json"]) == 0
    assert capsys.readouterr().err == ""


def test_what_plan_prints_is_what_it_writes_and_is_loaded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    shown = _json(capsys, "plan", BENDING, "--out", str(out))
    assert {path.name for path in out.iterdir()} == {
        "plan.json",
        "plan.png",
        "plan.csv",
        "shape.csv",
    }
    assert json.loads((out / "plan.json").read_text()) == shown
    p = load_plan(out / "plan.json")
    assert p.tensions.tolist() == shown["tensions_N"]
    assert p.certificate.passed
    assert p.targets == load(BENDING).targets
    jsonschema.validate(shown, schema_of("plan"))


@pytest.mark.slow
def test_settle_writes_a_table_of_the_shape(tmp_path: Path, calm: str) -> None:
    assert main(["settle", calm, "--out", str(tmp_path / "out"), "--figure", "pdf"]) == 0
    assert (tmp_path / "out" / "shape.pdf").read_bytes().startswith(b"%PDF")
    table = np.genfromtxt(tmp_path / "out" / "shape.csv", delimiter=",", names=True)
    q = read(CALM.encode())
    tip = settle(q.arm, q.tensions, q.scene, 1e-4).tip
    assert np.array_equal([table["x_m"][-1], table["y_m"][-1], table["z_m"][-1]], tip)


SCENE = """
tensions = [[0.3, 0.2, 0.0, 0.1]]
accuracy = 1e-4
[arm]
preset = "section-5.2"
[effects]
extension = true
"""
REACH = """
[target]
type = "tip-position"
position_mm = [300, 0, 900]
[limits]
tension_max = 2.0
"""


def written(folder: Path, text: str, name: str = "scene.toml") -> str:
    (folder / name).write_text(text)
    return str(folder / name)


def said(capsys: pytest.CaptureFixture[str], argv: list[str], code: int = 2) -> str:
    assert main(argv) == code
    return capsys.readouterr().err.strip()


def test_a_compiler_that_is_not_there_is_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", "nowhere")
    scene = "compile = true\narm = { preset = 'table-4' }\ntensions = [0,0,0,0,0,0,0,0,0,0,0,1]"
    for command in (
        ["settle", written(tmp_path, scene)],
        ["plan", BENDING, "--compile"],
    ):
        assert main(command) == 2
        assert "C compiler" in capsys.readouterr().err


@pytest.mark.slow
def test_a_full_disk_is_told_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, out = written(tmp_path, SCENE), tmp_path / "out"

    def full(self: Path, data: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", full)
    message = said(capsys, ["settle", scene, "--out", str(out)])
    assert (
        message == f"octoplan: {out}: no file was written in this folder: no space left on device"
    )
    assert not out.exists()


def test_two_exports_do_not_share_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = SCENE.replace("accuracy = 1e-4", "accuracy = 1e-3")
    one, other = written(tmp_path, text, "one.toml"), written(tmp_path, text, "other.toml")
    to = tmp_path / "c"
    assert main(["export", one, "--to", str(to)]) == 0
    before = {path.name: path.read_bytes() for path in to.iterdir()}
    assert main(["export", one, "--to", str(to)]) == 0
    message = said(capsys, ["export", other, "--to", str(to)])
    assert f"{to}: contains another export" in message
    assert str(to / "other") in message
    assert {path.name: path.read_bytes() for path in to.iterdir()} == before


# Contents of the file, the command, and the message with exit code 1.
UNSOLVED: dict[str, tuple[str, list[str], str]] = {
    "tensions that crush the arm": (
        SCENE.replace("[[0.3, 0.2, 0.0, 0.1]]", str([9] * 4)),
        ["settle"],
        "crushed",
    ),
    "effects of what does not settle": (
        SCENE.replace("[[0.3, 0.2, 0.0, 0.1]]", "[0, 0, 0, 0]").replace(
            "extension = true", "weight = { g = [-9.81, 0, 0] }"
        ),
        ["effects", "--out", "out"],
        "it buckles",
    ),
    "a target out of reach": (
        SCENE + REACH.replace("2.0", "1e3"),
        ["plan", "--accuracy", "1e-3"],
        "Not reached: the nearest shape found misses the tip position by",
    ),
    "a limit of time in the file": (
        "time_limit_s = 1e-9\n" + SCENE + REACH,
        ["plan"],
        "Stopped at the time limit",
    ),
}


@pytest.mark.quick(
    "effects of what does not settle", "a limit of time in the file", "tensions that crush the arm"
)
@pytest.mark.parametrize(("text", "argv", "told"), UNSOLVED.values(), ids=UNSOLVED)
def test_what_is_not_solved_is_told_with_1(
    text: str,
    argv: list[str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([argv[0], written(tmp_path, text), *argv[1:]]) == 1
    shown = capsys.readouterr()
    assert told in shown.out + shown.err
    assert not Path("out").exists()
