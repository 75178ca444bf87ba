"""Chunks as files: exact, complete or missing; chunks of other sweeps are kept."""

import errno
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from octoplan.model import InputError
from octoplan.planner import sweep
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.sweeps.definition import load_sweep
from octoplan.planner.frontends.sweeps.points import Rows, blank
from octoplan.planner.frontends.sweeps.store import ChunkFiles, FullDiskError, folder_of
from tests.sweeps.cases import GRID, written


def _rows(chunk: int) -> Rows:
    rows = blank("settle", 12, 1)
    rows["tip"][:] = np.random.default_rng(chunk).normal(size=(1, 3))
    rows["error"][:] = [np.nan]
    rows["outcome"][:] = f'chunk {chunk}: a "quoted" outcome\nof two lines'
    return rows


def _files(folder: Path, axes: str = GRID) -> ChunkFiles:
    return ChunkFiles(folder_of(folder / "out.nc"), load_sweep(written(folder, axes)))


def test_a_spoilt_chunk_is_told_and_computed_anew_once_it_is_removed(tmp_path: Path) -> None:
    path, out = written(tmp_path, GRID), tmp_path / "out.nc"
    files = _files(tmp_path)
    files.write(0, _rows(0))
    (chunk,) = files.folder.iterdir()
    spoilt = bytearray(chunk.read_bytes())
    spoilt[spoilt.index(_rows(0)["tip"].tobytes())] ^= 1
    chunk.write_bytes(spoilt)
    with pytest.raises(InputError, match="remove the file and run the sweep again") as caught:
        sweep(path, out)
    assert str(chunk) in str(caught.value)
    chunk.unlink()
    assert sweep(path, out).identical(sweep(path))


@pytest.mark.quick("later")
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
        with pytest.raises(FullDiskError, match="no space left on device; finished chunks"):
            sweep(path, out)
        assert main(["sweep", str(path), "--out", str(out)]) == 1
        assert "no space left on device" in capsys.readouterr().err
    assert len(list(folder.glob("*.npz"))) == kept
    assert folder.exists() == (kept > 0)
    assert not out.exists()
    assert {p.name for p in tmp_path.iterdir()} <= {"scene.toml", "sweep.toml", folder.name}
    assert sweep(path, out).identical(sweep(path))
