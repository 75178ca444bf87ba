"""A sweep as a NetCDF file or a Zarr folder, written part by part: memory holds one part only.

xarray writes the first point, with all names, units and conventions; the arrays are then made as
large as the sweep, and filled from the journal.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from model.errors import InputError
from model.extras import needed
from model.progress import tell
from planner.staging import staged
from planner.sweeps.dataset import coordinate, dataset
from planner.sweeps.definition import Sweep
from planner.sweeps.grid_slices import grid_slices
from planner.sweeps.journal import Journal
from planner.sweeps.summary import Summary
from planner.sweeps.variables import Rows, blank

# Points that are written at a time, and that lie together in the file.
_PART = 1000
_ENGINES = {".nc": "h5netcdf", ".zarr": "zarr"}


def check_store(path: Path) -> None:
    """Refuse a path that cannot be written, before anything runs; MissingExtraError, InputError."""
    suffix = path.suffix.lower()
    if suffix not in _ENGINES:
        raise InputError("out", str(path), "a name that ends in .nc (NetCDF) or .zarr (Zarr)")
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise InputError("out", str(path), "a name in a folder that is there and can be written to")
    if suffix == ".nc" and path.is_dir():
        raise InputError("out", str(path), "a file: this is a folder")
    if suffix == ".zarr" and path.exists() and not path.is_dir():
        raise InputError("out", str(path), "a folder of Zarr: this is a file")
    packages = {"h5netcdf": "sweep", "h5py": "sweep"} if suffix == ".nc" else {"zarr": "zarr"}
    for package, extra in packages.items():
        needed(package, extra)


def save(sweep: Sweep, journal: Journal, path: Path) -> Summary:
    """Write what a journal holds to a path, whole or not at all, and return what became of it.

    Raises InputError where it cannot be written.
    """
    try:
        with staged(path.parent) as folder:
            new, old = folder / f"new{path.suffix.lower()}", folder / "old"
            with _grown(sweep, dataset(sweep, journal.read(0).part(0, 1), first=True), new) as put:
                summary = _fill(sweep, journal, put)
            if path.is_dir():
                # A folder cannot take the place of another at once.
                path.replace(old)
            new.replace(path)
        return summary
    except OSError as reason:
        told = f"a place that can be written to: {(reason.strerror or str(reason)).lower()}"
        raise InputError("out", str(path), told) from None


def opened(path: Path) -> Any:
    """Return a Dataset whose numbers are read from its file when they are looked at."""
    xarray = needed("xarray", "sweep")
    return xarray.open_dataset(path, engine=_ENGINES[path.suffix.lower()])


def identity_in(path: Path) -> str:
    """Return the identity of the sweep that a path holds; empty where it holds none."""
    if not path.exists():
        return ""
    try:
        with opened(path) as found:
            return str(found.attrs.get("identity", ""))
    except (OSError, ValueError, KeyError):
        return ""


def summary_in(path: Path, sweep: Sweep) -> Summary:
    """Return what became of a sweep's points that are written to a path, read part by part."""
    summary, good = Summary(), "reached" if sweep.job.compute == "plan" else "settled"
    shape = tuple(sweep.dims.values())
    with opened(path) as found:
        for begin in range(0, sweep.size, _PART):
            for box, _, _ in grid_slices(begin, min(begin + _PART, sweep.size), shape):
                values = {good: np.ravel(found[good][box].values)}
                summary.add(Rows(values, [str(x) for x in np.ravel(found["outcome"][box].values)]))
    return summary


@contextmanager
def _grown(sweep: Sweep, first: Any, path: Path) -> Iterator[Any]:
    """Write a Dataset of the first point, make room for all, and yield its arrays to be filled."""
    sizes = {**first.sizes, **sweep.dims}
    room = {name: tuple(sizes[dim] for dim in own.dims) for name, own in first.variables.items()}
    growing = [name for name, own in first.variables.items() if set(own.dims) & set(sweep.dims)]
    parts = {name: _parts(first[name].dims, room[name], sweep) for name in growing}
    if path.suffix.lower() == ".nc":
        layout = {name: {"chunksizes": parts[name]} for name in growing}
        growth = {"unlimited_dims": list(sweep.dims), "encoding": layout}
        first.to_netcdf(path, engine="h5netcdf", **growth)
        with needed("h5netcdf", "sweep").File(path, "r+") as file:
            for dim, size in sweep.dims.items():
                file.resize_dimension(dim, size)
            yield file.variables
        return
    zarr = needed("zarr", "zarr")
    layout = {name: {"chunks": parts[name]} for name in growing}
    # Texts are no settled part of Zarr's format 3 yet.
    first.to_zarr(path, zarr_format=2, consolidated=False, encoding=layout)
    arrays = dict(zarr.open_group(path, mode="r+").arrays())
    for name in growing:
        arrays[name].resize(room[name])
    yield arrays
    zarr.consolidate_metadata(path, zarr_format=2)


def _parts(dims: tuple[str, ...], shape: tuple[int, ...], sweep: Sweep) -> tuple[int, ...]:
    """Return how an array is cut: some thousand points that follow each other lie together."""
    parts, left = list(shape), _PART
    for i in reversed([i for i, dim in enumerate(dims) if dim in sweep.dims]):
        parts[i] = min(shape[i], left)
        left = max(left // parts[i], 1)
    return tuple(parts)


def _fill(sweep: Sweep, journal: Journal, arrays: Any) -> Summary:
    summary = Summary()
    for axis in sweep.axes:
        for begin in range(0, len(axis.values), _PART):
            end = min(begin + _PART, len(axis.values))
            _put(arrays[axis.name], (slice(begin, end),), coordinate(axis, begin, end))
    together = max(_PART // sweep.chunk, 1)
    for chunk in range(0, sweep.chunks, together):
        begin = chunk * sweep.chunk
        rows = _read(sweep, journal, chunk, min(chunk + together, sweep.chunks))
        summary.add(rows)
        for box, a, b in grid_slices(begin, begin + len(rows.outcomes), tuple(sweep.dims.values())):
            shape = tuple(own.stop - own.start for own in box)
            part = rows.part(a - begin, b - begin)
            for name, own in part.values.items():
                _put(arrays[name], box, own.reshape(*shape, *own.shape[1:]))
            outcomes = np.array(part.outcomes, dtype=object)
            _put(arrays["outcome"], box, outcomes.reshape(shape))
        tell("points written", begin + len(rows.outcomes), sweep.size)
    return summary


def _read(sweep: Sweep, journal: Journal, first: int, last: int) -> Rows:
    """Return the rows of chunks that follow each other."""
    points = min(last * sweep.chunk, sweep.size) - first * sweep.chunk
    rows = blank(sweep.job.compute, sweep.job.tendons, points)
    for chunk in range(first, last):
        rows.put((chunk - first) * sweep.chunk, journal.read(chunk))
    return rows


def _put(array: Any, box: tuple[slice, ...], values: Any) -> None:
    array[box] = values if values.dtype == object else values.astype(array.dtype)
