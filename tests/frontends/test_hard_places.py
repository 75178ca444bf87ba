"""Files and outputs that systems and people come up with: a sentence, and nothing left behind."""

from __future__ import annotations

import os
import resource
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from octoplan.model import Arm, InputError, OctoplanError, Scene
from octoplan.model.effects import Extension
from octoplan.model.support.errors import FileError
from octoplan.planner import export, load_plan
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.io.files import staging_folder, write_named, write_together
from octoplan.planner.frontends.io.scene_file import load, read
from octoplan.planner.frontends.sweeps.definition import load_sweep

SCENE = """
tensions = [[0.5, 0, 0, 0], [0, 0, 1, 0], [2, 0, 0, 0]]
accuracy = 1e-3
[arm]
preset = "table-4"
[effects]
extension = true
"""
LONG = "x" * 300


@pytest.fixture(autouse=True)
def inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    yield


def octoplan(*argv: str, **options: Any) -> subprocess.CompletedProcess[str]:
    root = Path(__file__).parents[2]
    begin = f"import sys; sys.path.insert(0, {str(root)!r}); "
    begin += "from octoplan.planner.frontends.cli import main"
    command = [sys.executable, "-c", f"{begin}; sys.exit(main())", *argv]
    told = {"stderr": subprocess.PIPE, "text": True, "check": False}
    return subprocess.run(command, **{**told, **options})


DIGITS = ["1" * 400, "1" * 5000, "0x" + "f" * 5000, f"[{'9' * 5000}]"]


@pytest.mark.parametrize("number", DIGITS, ids=["400", "5000", "5000 hexadecimal", "a list"])
@pytest.mark.parametrize("key", ["accuracy", "tensions"])
def test_numbers_of_thousands_of_digits_are_refused_in_short(number: str, key: str) -> None:
    lines = [f"{key} = {number}" if own.startswith(key) else own for own in SCENE.splitlines()]
    with pytest.raises(FileError) as caught:
        read("\n".join(lines).encode())
    assert len(str(caught.value)) < 1000


ECHOED = {
    "a key": lambda long: f"{long} = 1\n{SCENE}",
    "a text": lambda long: SCENE.replace("table-4", long),
    "a line": lambda long: f"{SCENE}\n{long} {long}",
    "a list": lambda long: SCENE.replace("1e-3", str([0.1] * len(long))),
    "a table": lambda long: f"{SCENE}\n[{long}.a]\nb = 1",
    "a unit": lambda long: SCENE.replace('preset = "table-4"', f"length_mm = [{long}]"),
}


@pytest.mark.parametrize("write", ECHOED.values(), ids=ECHOED)
def test_messages_do_not_repeat_a_hundred_thousand_characters(write: Callable[[str], str]) -> None:
    with pytest.raises(OctoplanError) as caught:
        read(write("x" * 100_000).encode())
    assert len(str(caught.value)) < 2000


@pytest.mark.parametrize(
    "argv", [["x" * 100_000], ["plan", "x" * 100_000], ["plan", "--" + LONG * 99]]
)
def test_nor_do_those_of_the_command_line(
    argv: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(argv) == 2
    assert len(capsys.readouterr().err) < 2100


@pytest.mark.parametrize("name", [f"{LONG}.toml", "a\x00b.toml", "dir\x00/scene.toml"])
def test_names_that_no_file_can_have_are_told(name: str) -> None:
    for use in (load, load_sweep, load_plan):
        with pytest.raises(FileError, match=r"too long|null"):
            use(name)
    Path("sweep.toml").write_text(
        f"scene = {name!r}".replace("\\x00", "\\u0000").replace("'", '"')
        + '\n[sweep]\ncompute = "settle"\n[[sweep.axes]]\nkey = "arm.E_kPa"\nvalues = [9.0]'
    )
    with pytest.raises(FileError, match=r"too long|null"):
        load_sweep("sweep.toml")


@pytest.mark.parametrize(
    "argv", [["settle", "scene.toml", "--out"], ["export", "scene.toml", "--to"]]
)
@pytest.mark.parametrize("folder", [LONG, f"a/{LONG}", "a\x00b", "scene.toml", "scene.toml/a"])
def test_folders_that_cannot_be_are_told(
    argv: list[str], folder: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*argv, folder]) == 2
    assert "folder" in capsys.readouterr().err
    assert [path.name for path in Path().rglob("*") if path.is_file()] == ["scene.toml"]


@pytest.mark.parametrize("use", [load, load_sweep, load_plan])
def test_a_pipe_in_place_of_a_file_is_not_waited_for(use: Callable[[str], Any]) -> None:
    os.mkfifo("pipe.toml")
    with pytest.raises(FileError, match="no ordinary file"):
        use("pipe.toml")


@pytest.mark.quick("argv0")
@pytest.mark.parametrize(
    "argv", [["settle", "scene.toml"], ["--help"], ["settle", "--help"], ["--version"]]
)
def test_a_full_standard_output_is_told(argv: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = octoplan(*argv, stdout=full)
    assert (done.returncode, done.stderr.count("\n")) == (74, 1), done.stderr
    assert "standard output cannot be written: no space left" in done.stderr


@pytest.mark.slow
def test_a_closed_standard_output_is_told() -> None:
    done = octoplan("settle", "scene.toml", preexec_fn=lambda: os.close(1))
    assert (done.returncode, done.stderr.count("\n")) == (74, 1), done.stderr


BAD_NAMES = [".", "..", ".zattrs", ".zgroup", "zarr.json", "a/b", "a\\\\b", "", " ", "a ", "a\\nb"]


@pytest.mark.parametrize("name", [*BAD_NAMES, "x" * 201])
def test_axes_whose_names_files_cannot_have_are_refused_before_anything_runs(name: str) -> None:
    Path("sweep.toml").write_text(
        f'scene = "scene.toml"\n[sweep]\ncompute = "settle"\n[[sweep.axes]]\nname = "{name}"\n'
        'key = "arm.E_kPa"\nvalues = [9.0]'
    )
    with pytest.raises(FileError, match="a name without /"):
        load_sweep("sweep.toml")


def test_a_function_is_not_named_as_casadi_s_are_not() -> None:
    for name in ("a__b", "a_", "jac"):
        with pytest.raises(InputError, match="name"):
            export(Arm.from_paper("table-4"), Scene(Extension()), "c", [0.1] * 12, name=name)


def test_a_result_of_which_one_file_cannot_be_written_is_not_there() -> None:
    Path("out/shape.json").mkdir(parents=True)
    assert main(["settle", "scene.toml", "--out", "out"]) == 2
    assert [path.name for path in Path("out").iterdir()] == ["shape.json"]


@pytest.mark.slow
def test_files_that_grow_too_large_leave_nothing() -> None:
    def small() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))

    done = octoplan("settle", "scene.toml", "--out", "out", preexec_fn=small)
    assert done.returncode == 2, done.stderr
    assert "file too large" in done.stderr
    assert not Path("out").exists()


@pytest.mark.parametrize(("mask", "mode"), [(0o077, 0o600), (0o022, 0o644), (0o002, 0o664)])
def test_files_are_readable_for_those_whom_the_umask_lets(mask: int, mode: int) -> None:
    before = os.umask(mask)
    try:
        write_named("a.b", ".b", b"")
        write_together(Path("out"), {"b": b""})
    finally:
        os.umask(before)
    assert [stat.S_IMODE(path.stat().st_mode) for path in (Path("a.b"), Path("out/b"))] == [
        mode
    ] * 2


KILLED = """
import os, signal
from pathlib import Path
from octoplan.planner.frontends.io.files import staging_folder
with staging_folder(Path()) as folder:
    (folder / "half.png").write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.slow
def test_what_a_killed_run_has_left_goes_with_the_next() -> None:
    there = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    subprocess.run([sys.executable, "-c", KILLED], env=there, check=False)
    assert len(list(Path().iterdir())) == 2
    with staging_folder(Path()):
        write_named("a.png", ".png", b"whole")
    assert sorted(path.name for path in Path().iterdir()) == ["a.png", "scene.toml"]
