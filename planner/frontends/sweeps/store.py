"""Storage of a sweep: a file for each finished chunk, and an xarray Dataset of all chunks.

The file of a chunk is written atomically, in a folder beside the output of the sweep. Its name has
the identity of the sweep and the number of the chunk, so that the file names are the whole state of
an interrupted run. Dask reads the chunks one by one for xarray, so that few chunks are in memory.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch
from zipfile import BadZipFile

import msgspec
import numpy as np
from numpy.typing import NDArray

from octoplan.model.support.errors import InputError, OctoplanError, needed
from octoplan.model.support.progress import check_time, report
from octoplan.planner.frontends.io.files import (
    atomic_replace,
    remember_written,
    system_message,
    versions,
)
from octoplan.planner.frontends.sweeps.definition import Sweep
from octoplan.planner.frontends.sweeps.points import LABELS, VARIABLES, Variable
from octoplan.planner.frontends.sweeps.work import Rows, Work


class FullDiskError(OctoplanError):
    """Results of a sweep cannot be written.

    Attributes
    ----------
    path : str
        The file that could not be written.
    reason : str
        Message of the operating system.
    """

    def __init__(self, path: str, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(
            f"{path} cannot be written: {reason}; finished chunks are kept: make space, then run "
            "the sweep again to compute the others"
        )


@contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Raise FullDiskError for an OSError of the block."""
    try:
        yield
    except OSError as reason:
        raise FullDiskError(str(path), system_message(reason)) from None


def folder_of(out: Path) -> Path:
    """Return the folder of the chunks for an output path."""
    return out.with_name(f"{out.name}.chunks")


@dataclass(frozen=True)
class ChunkFiles:
    """The files of the finished chunks of some work, such as a sweep.

    Attributes
    ----------
    folder : Path
        Created with the first chunk.
    work : Work
    """

    folder: Path
    work: Work

    def __post_init__(self) -> None:
        """Raise InputError if the folder contains chunks of another sweep."""
        existing = self.folder.glob("*.npz")
        if not all(path.name.startswith(self._prefix) for path in existing):
            allowed = (
                "a folder of chunks of this sweep and version; "
                "choose another output, or remove the folder"
            )
            raise InputError("out", str(self.folder), allowed)
        self._keep()

    def _keep(self) -> None:
        text = f"finished chunks are kept in {self.folder}; the same command computes the others"
        remember_written(self.folder, text)

    @property
    def left(self) -> list[int]:
        """Numbers of the unfinished chunks."""
        there = {path.name for path in self.folder.glob("*.npz")}
        return [i for i in range(self.work.chunks) if self._path(i).name not in there]

    def write(self, chunk: int, rows: Rows) -> None:
        """Write a chunk to disk and flush the file; raise FullDiskError."""
        path = self._path(chunk)
        texts = {"outcome": rows["outcome"].astype(str)}
        with (
            disk_errors(path),
            atomic_replace(path, self.folder.parent) as part,
            part.open("wb") as stream,
        ):
            np.savez(stream, allow_pickle=False, **rows | texts)
            stream.flush()
            os.fsync(stream.fileno())
        self._keep()

    def read(self, chunk: int, name: str) -> NDArray[Any]:
        """Return a variable of a finished chunk; raise InputError if the file is damaged."""
        path = self._path(chunk)
        try:
            with np.load(path, allow_pickle=False) as stored:
                return np.asarray(stored[name])
        except (OSError, ValueError, KeyError, EOFError, BadZipFile):
            allowed = "an undamaged chunk: remove the file and run the sweep again"
            raise InputError("out", str(path), allowed) from None

    def _path(self, chunk: int) -> Path:
        return self.folder / f"{self._prefix}{chunk:06d}.npz"

    @property
    def _prefix(self) -> str:
        return f"{self.work.identity[:16]}-"


# The Dataset

# Points that are read at a time.
_READ = 4096
# Size of the blocks that are written at a time, and of chunks in Zarr [bytes].
_BLOCK = 200_000
_ENGINES = {".nc": "h5netcdf", ".zarr": "zarr"}
_NUMBER = re.compile(r"-?\d[\d.]*(e[+-]?\d+)?")


def gather(sweep: Sweep, chunks: ChunkFiles) -> Any:
    """Return the Dataset of a sweep, lazily; all chunks are checked first."""
    xarray = needed("xarray", "sweep")
    summary, width = _summary(sweep, chunks)
    variables = dict[str, Any]()
    coords = dict[str, Any]()
    for name, item in VARIABLES[sweep.job.compute].items():
        units = {"units": item.units} if item.units else {}
        array = _array(sweep, chunks, name, item, width)
        variables[name] = ((*sweep.dims, *item.dims), array, {**units, "long_name": item.about})
    for axis in sweep.axes:
        attributes = {"key": axis.key, **({"units": axis.unit} if axis.unit else {})}
        coords[axis.name] = (("draw" if axis.drawn else axis.name,), axis.values, attributes)
    used = {dim for item in VARIABLES[sweep.job.compute].values() for dim in item.dims}
    labels = {**LABELS, "tendon": list(sweep.job.tendons)}
    coords |= {dim: ((dim,), text, {}) for dim, text in labels.items() if dim in used}
    numbers = {f"{name}_version": number for name, number in versions().items()}
    texts = {f"{name}_file": text for name, text in sweep.texts.items()}
    computed = {"compute": sweep.job.compute, "identity": sweep.identity}
    resolved = {"scene": msgspec.json.encode(sweep.job.scene).decode()}
    attributes = {"title": "octoplan sweep", **computed, **numbers, **texts, **resolved, **summary}
    return xarray.Dataset(variables, coords, attributes)


def _array(sweep: Sweep, kept: ChunkFiles, name: str, each: Variable, width: int) -> Any:
    """Return a variable as a Dask array, assembled from chunks in the shape of the grid."""
    array = needed("dask.array", "sweep")
    kind = np.dtype(f"U{width}" if each.blank == "" else type(each.blank))
    sizes = each.sizes(len(sweep.job.tendons))
    several = max(1, _READ // sweep.chunk)

    def part(block_id: tuple[int, ...]) -> NDArray[Any]:
        first = block_id[0] * several
        there = range(first, min(first + several, sweep.chunks))
        check_time()
        report("chunks gathered", there.stop, sweep.chunks)
        return np.concatenate([kept.read(chunk, name).astype(kind) for chunk in there])

    at_once = several * sweep.chunk
    parts = tuple(min(at_once, sweep.size - i) for i in range(0, sweep.size, at_once))
    like = np.empty((0,) * (1 + len(sizes)), kind)
    chunks = (parts, *((size,) for size in sizes))
    flat = array.map_blocks(part, chunks=chunks, dtype=kind, meta=like)
    shape = (*sweep.dims.values(), *sizes)
    blocks = array.core.normalize_chunks("auto", shape, _BLOCK, kind)
    return flat.reshape(shape).rechunk(blocks)


def save(data: Any, path: Path) -> None:
    """Write a Dataset to a path, atomically; raise FullDiskError. Use inside sequential_dask."""
    with disk_errors(path), atomic_replace(path) as part:
        if path.suffix.lower() == ".nc":
            data.to_netcdf(part, engine="h5netcdf")
        else:
            # Zarr format 3 does not specify texts yet.
            data.to_zarr(part, zarr_format=2, consolidated=True)


@contextmanager
def sequential_dask() -> Iterator[None]:
    """Make Dask compute block by block inside the block, so that memory holds a single one.

    Hide `distributed`, which xarray would import to detect a cluster.
    """
    dask = needed("dask", "sweep")
    name = "distributed"
    hidden = {} if name in sys.modules else {name: None}
    with dask.config.set(scheduler=dask.get), patch.dict(sys.modules, hidden):
        yield


def check_store(path: Path) -> None:
    """Raise InputError or MissingExtraError if a path cannot be written, before any computation."""
    suffix = path.suffix.lower()
    if suffix not in _ENGINES:
        raise InputError("out", str(path), "a name that ends in .nc (NetCDF) or .zarr (Zarr)")
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise InputError("out", str(path), "a name in an existing folder with write permission")
    if path.exists() and path.is_dir() != (suffix == ".zarr"):
        allowed = "a Zarr folder, not a file" if suffix == ".zarr" else "a file, not a folder"
        raise InputError("out", str(path), allowed)
    packages = {"h5netcdf": "sweep", "h5py": "sweep"} if suffix == ".nc" else {"zarr": "zarr"}
    for package, extra in packages.items():
        needed(package, extra)


def open_dataset(path: Path) -> Any:
    """Return a Dataset whose numbers are read from the file on demand."""
    xarray = needed("xarray", "sweep")
    return xarray.open_dataset(path, engine=_ENGINES[path.suffix.lower()])


def attributes_in(path: Path) -> dict[str, Any]:
    """Return the attributes of the Dataset at a path; empty if there is none."""
    if path.exists():
        with suppress(OSError, ValueError, KeyError), open_dataset(path) as data:
            return dict(data.attrs)
    return {}


def _summary(sweep: Sweep, kept: ChunkFiles) -> tuple[dict[str, Any], int]:
    """Return the numbers of successes and failures as attributes, and the longest outcome.

    Outcomes that differ in numbers only are counted together, under the first outcome.
    """
    met = 0
    width = 1
    kinds: dict[str, tuple[str, int]] = {}
    for chunk in range(sweep.chunks):
        good = kept.read(chunk, "reached" if sweep.job.compute == "plan" else "settled")
        outcomes = kept.read(chunk, "outcome")
        met += int(good.sum())
        width = max(width, outcomes.dtype.itemsize // 4)
        for outcome in outcomes[~good].tolist():
            example, count = kinds.get(kind := _NUMBER.sub("#", outcome), (outcome, 0))
            kinds[kind] = (example, count + 1)
    failures = dict(sorted(kinds.values(), key=lambda item: -item[1]))
    return {"met": met, "failures": json.dumps(failures)}, width
