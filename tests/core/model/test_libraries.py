"""Compiled code on disk: built once, safe among processes, never loaded after a change."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import shutil
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from octoplan.model.support.errors import CompilerError
from octoplan.model.support.machine.compiled import _command, cache_folder, library

pytestmark = [
    pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler"),
    pytest.mark.skipif(sys.platform != "linux", reason="the cache folder is set the way of Linux"),
]
SOURCE = "int answer(void) { return 42; }\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return cache_folder()


def answer(path: Path) -> int:
    return int(ctypes.CDLL(str(path)).answer())


def test_a_library_is_built_once_and_kept_in_the_users_cache_folder(folder: Path) -> None:
    first = library(SOURCE, "-O1")
    built = first.stat().st_mtime_ns
    assert first.parent == folder
    assert library(SOURCE, "-O1") == first
    assert first.stat().st_mtime_ns == built
    assert answer(first) == 42
    assert list(folder.iterdir()) == [first]


@pytest.mark.parametrize("damage", ["truncated", "poisoned", "empty", "another's"])
def test_a_damaged_library_is_built_again_and_never_loaded(damage: str) -> None:
    path = library(SOURCE, "-O1")
    whole = path.read_bytes()
    other = library(SOURCE.replace("42", "13"), "-O1").read_bytes()
    path.write_bytes(
        {
            "truncated": whole[: len(whole) // 2],
            "poisoned": whole[:-100] + bytes(100),
            "empty": b"",
            "another's": other,
        }[damage]
    )
    again = library(SOURCE, "-O1")
    assert again.read_bytes() == whole
    assert answer(again) == 42


def test_several_may_build_the_same_at_once(folder: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda _: library(SOURCE, "-O1"), range(8)))
    assert {answer(path) for path in found} == {42}
    assert [*folder.iterdir()] == [*{*found}]


def test_without_a_folder_that_can_be_written_it_works_and_warns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.warns(RuntimeWarning, match="compiled again by each process"):
        assert answer(library(SOURCE, "-O1")) == 42


@pytest.mark.slow
def test_a_compiler_installed_by_pip_does(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ziglang")
    monkeypatch.setattr("octoplan.model.support.machine.compiled._NAMES", ())
    assert _command("") == (sys.executable, "-m", "ziglang", "cc")
    monkeypatch.setenv("CC", " ".join(_command("")))
    assert answer(library(SOURCE, "-O1")) == 42


def _built(name: str) -> int:
    os.environ["XDG_CACHE_HOME"] = name
    return answer(library(SOURCE, "-O1"))


@pytest.mark.slow
def test_several_processes_may_build_the_same_at_once(tmp_path: Path, folder: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(4) as pool:
        assert pool.map(_built, [str(tmp_path)] * 4, chunksize=1) == [42] * 4
    assert len(list(folder.iterdir())) == 1


def test_what_the_compiler_says_is_told(folder: Path) -> None:
    with pytest.raises(CompilerError, match="undeclared"):
        library("int answer(void) { return missing; }\n", "-O1")
    assert not list(folder.iterdir())
