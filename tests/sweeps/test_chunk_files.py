"""Chunks as files: back bit for bit, whole or not at all; those of other sweeps are kept."""

import errno
import os
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from model import InputError
from planner import sweep
from planner.cli import main
from planner.io import files as files_of_io
from planner.sweeps.definition import load_sweep
from planner.sweeps.points import Rows, blank
from planner.sweeps.store import ChunkFiles, FullDiskError, folder_of
from tests.sweeps.cases import GRID, written


def _rows(chunk: int) -> Rows:
    rows = blank("settle", 12, 1, 60)
    rows["tip"][:] = np.random.default_rng(chunk).normal(size=(1, 3))
    rows["error"][:] = [np.nan]
    rows["outcome"][:] = f'chunk {chunk}: a "quoted" outcome\nof two lines'
    return rows


def _files(folder: Path, axes: str = GRID) -> ChunkFiles:
    return ChunkFiles(folder_of(folder / "out.nc"), load_sweep(written(folder, axes)))


def test_what_was_finished_comes_back_bit_for_bit(tmp_path: Path) -> None:
    for chunk in (0, 2):
        _files(tmp_path).write(chunk, _rows(chunk))
    again = _files(tmp_path)
    assert again.left == [1]
    for chunk in (0, 2):
        for name, own in _rows(chunk).items():
            assert again.read(chunk, name).tobytes() == own.tobytes()


def test_a_part_of_a_file_is_no_chunk(tmp_path: Path) -> None:
    files = _files(tmp_path)
    files.write(0, _rows(0))
    (path,) = files.folder.iterdir()
    (files.folder / f"{path.name}.part").write_bytes(path.read_bytes()[:100])
    assert _files(tmp_path).left == [1, 2]


def test_a_spoilt_chunk_is_told_and_computed_anew_once_it_is_removed(tmp_path: Path) -> None:
    path, out = written(tmp_path, GRID), tmp_path / "out.nc"
    files = _files(tmp_path)
    files.write(0, _rows(0))
    (chunk,) = files.folder.iterdir()
    spoilt = bytearray(chunk.read_bytes())
    spoilt[spoilt.index(_rows(0)["tip"].tobytes())] ^= 1
    chunk.write_bytes(spoilt)
    with pytest.raises(InputError, match="remove it, start again") as caught:
        sweep(path, out)
    assert str(chunk) in str(caught.value)
    chunk.unlink()
    assert sweep(path, out).identical(sweep(path))


def test_the_chunks_of_another_sweep_are_refused_and_kept(tmp_path: Path) -> None:
    _files(tmp_path).write(0, _rows(0))
    with pytest.raises(InputError, match="of another"):
        _files(tmp_path, GRID.replace("count = 3", "count = 4"))
    assert _files(tmp_path).left == [1, 2]


def test_what_an_earlier_version_left_of_a_sweep_is_told_and_kept(tmp_path: Path) -> None:
    """Used to be left beside a sweep that began anew."""
    journal = tmp_path / "out.nc.journal"
    journal.write_text("chunks")
    with pytest.raises(InputError, match="finish it there, or remove this file"):
        sweep(written(tmp_path, GRID), tmp_path / "out.nc")
    assert journal.read_text() == "chunks"
    assert not (tmp_path / "out.nc").exists()


@pytest.mark.parametrize("chunks", [0, 1])
def test_what_ends_a_command_at_once_leaves_no_folder_of_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunks: int
) -> None:
    monkeypatch.setattr(files_of_io, "_kept", deque())
    files = _files(tmp_path)
    for chunk in range(chunks):
        files.write(chunk, _rows(chunk))
    with files_of_io.staged(tmp_path) as folder:
        (folder / "half").touch()
        told = files_of_io.end()
        assert not folder.exists()
    assert ("nothing" in told) == (chunks == 0)
    assert files.folder.exists() == (chunks > 0)


@pytest.mark.parametrize("when", ["first", "later", "gathered"])
def test_a_full_disk_is_told_and_nothing_computed_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], when: str
) -> None:
    path, out = written(tmp_path, GRID), tmp_path / "out.nc"
    folder, savez, kept = folder_of(out), np.savez, {"first": 0, "later": 2, "gathered": 3}[when]

    def full(*args: Any, **kwargs: Any) -> None:
        if when != "gathered" and len(list(folder.glob("*.npz"))) == kept:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        savez(*args, **kwargs)

    def unwritable(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(np, "savez", full)
        if when == "gathered":
            patch.setattr("xarray.Dataset.to_netcdf", unwritable)
        with pytest.raises(FullDiskError, match="no space left on device; what is finished"):
            sweep(path, out)
        assert main(["sweep", str(path), "--out", str(out)]) == 1
        assert "no space left on device" in capsys.readouterr().err
    assert len(list(folder.glob("*.npz"))) == kept
    assert folder.exists() == (kept > 0)
    assert not out.exists()
    assert {p.name for p in tmp_path.iterdir()} <= {"scene.toml", "sweep.toml", folder.name}
    assert sweep(path, out).identical(sweep(path))
