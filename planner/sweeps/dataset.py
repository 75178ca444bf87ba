"""The chunks of a sweep gathered in an xarray Dataset, with units and what it was made from.

Dask reads, block by block, what xarray writes, so that memory holds a block only.
"""

from __future__ import annotations

import json
import math
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import msgspec
import numpy as np
from numpy.typing import NDArray

from model.errors import InputError, needed
from model.progress import tell
from model.time_limit import check_time
from planner.io.files import staged, versions, why
from planner.sweeps.chunk_files import FullDiskError
from planner.sweeps.definition import Sweep, box_sizes
from planner.sweeps.variables import LABELS, VARIABLES, Variable, dtype_of, success

# What a variable of a chunk is read by.
Read = Callable[[int, str], NDArray[Any]]
# Points that are read and written at a time, and lie together in a Zarr folder.
_BLOCK = 1000
_ENGINES = {".nc": "h5netcdf", ".zarr": "zarr"}
_NUMBER = re.compile(r"-?\d[\d.]*(e[+-]?\d+)?")


def gathered(sweep: Sweep, read: Read) -> Any:
    """Return the Dataset of a sweep, all of whose chunks can be read; it is read when looked at."""
    xarray = needed("xarray", "sweep")
    summary, width = _summary(sweep, read)
    variables, coords = dict[str, Any](), dict[str, Any]()
    for name, own in VARIABLES[sweep.compute].items():
        units = {"units": own.units} if own.units else {}
        array = _array(sweep, partial(_block, sweep, read, name, own, width), own, width)
        variables[name] = ((*sweep.dims, *own.dims), array, {**units, "long_name": own.about})
    for axis in sweep.axes:
        attributes = {"key": axis.key, **({"units": axis.unit} if axis.unit else {})}
        coords[axis.name] = (("draw" if axis.drawn else axis.name,), axis.values, attributes)
    used = {dim for own in VARIABLES[sweep.compute].values() for dim in own.dims}
    labels = {**LABELS, "tendon": list(sweep.tendons)}
    coords |= {dim: ((dim,), text, {}) for dim, text in labels.items() if dim in used}
    numbers = {f"{name}_version": number for name, number in versions().items()}
    texts = {f"{name}_file": text for name, text in sweep.texts.items()}
    computed = {"compute": sweep.compute, "identity": sweep.identity}
    resolved = {"scene": msgspec.json.encode(sweep.scene).decode()}
    made = {"title": "octoplan sweep", **computed, **numbers, **texts, **resolved, **summary}
    return xarray.Dataset(variables, coords, made)


def _together(sweep: Sweep) -> tuple[int, ...]:
    """Return how many chunks along each dimension make a block."""
    return box_sizes(sweep.counts, max(_BLOCK // math.prod(sweep.chunk), 1))


def _array(sweep: Sweep, block: Callable[..., Any], own: Variable, width: int) -> Any:
    """Return a variable as an array of Dask's, whose blocks are some chunks each."""
    points, sizes = tuple(sweep.dims.values()), own.sizes(len(sweep.tendons))
    steps = (m * n for m, n in zip(_together(sweep), sweep.chunk, strict=True))
    chunks = [
        (m,) * (n // m) + ((n % m,) if n % m else ()) for n, m in zip(points, steps, strict=True)
    ]
    kind = dtype_of(own, width)
    like = np.empty((0,) * (len(points) + len(sizes)), kind)
    own_sizes = [(size,) for size in sizes]
    given = {"chunks": (*chunks, *own_sizes), "dtype": kind, "meta": like}
    return needed("dask.array", "sweep").map_blocks(block, **given)


def _block(
    sweep: Sweep, read: Read, name: str, own: Variable, width: int, block_id: tuple[int, ...]
) -> NDArray[Any]:
    """Return a variable of the chunks of a block (sizes of the block, its own sizes)."""
    check_time()
    begins = list(zip(block_id, _together(sweep), strict=False))
    inside = np.ix_(*(range(i * m, min(i * m + m, n))
                      for (i, m), n in zip(begins, sweep.counts, strict=True)))  # fmt: skip
    chunks = np.arange(sweep.chunks).reshape(sweep.counts)[inside]
    first, last = (sweep.box(int(chunks.flat[i])) for i in (0, -1))
    shape = [b.stop - a.start for a, b in zip(first, last, strict=True)]
    found = np.empty((*shape, *own.sizes(len(sweep.tendons))), dtype_of(own, width))
    for chunk in chunks.ravel().tolist():
        box = zip(first, sweep.box(chunk), strict=True)
        place = tuple(slice(b.start - a.start, b.stop - a.start) for a, b in box)
        found[place] = read(chunk, name).reshape(found[place].shape)
    tell("chunks gathered", int(chunks.flat[-1]) + 1, sweep.chunks)
    return found


def save(data: Any, path: Path) -> None:
    """Write a Dataset to a path, whole or not at all; raises FullDiskError."""
    suffix = path.suffix.lower()
    try:
        with staged(path.parent) as folder, in_order():
            new = folder / f"new{suffix}"
            if suffix == ".nc":
                data.to_netcdf(new, engine="h5netcdf")
            else:
                # Texts are no settled part of Zarr's format 3 yet.
                data.to_zarr(new, zarr_format=2, consolidated=True)
            if path.is_dir():
                # A folder cannot take the place of another at once.
                path.replace(folder / "old")
            new.replace(path)
    except OSError as reason:
        raise FullDiskError(str(path), why(reason)) from None


@contextmanager
def in_order() -> Iterator[None]:
    """Let Dask compute block after block, so that memory holds one.

    xarray would load all of distributed to see whether a cluster writes.
    """
    dask, name = needed("dask", "sweep"), "distributed"
    hidden = {} if name in sys.modules else {name: None}
    with dask.config.set(scheduler=dask.get), patch.dict(sys.modules, hidden):
        yield


def check_store(path: Path) -> None:
    """Refuse a path that cannot be written, before anything runs; MissingExtraError, InputError."""
    suffix = path.suffix.lower()
    if suffix not in _ENGINES:
        raise InputError("out", str(path), "a name that ends in .nc (NetCDF) or .zarr (Zarr)")
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise InputError("out", str(path), "a name in a folder that is there and can be written to")
    if path.exists() and path.is_dir() != (suffix == ".zarr"):
        what = "a folder of Zarr, not a file" if suffix == ".zarr" else "a file, not a folder"
        raise InputError("out", str(path), what)
    packages = {"h5netcdf": "sweep", "h5py": "sweep"} if suffix == ".nc" else {"zarr": "zarr"}
    for package, extra in packages.items():
        needed(package, extra)


def opened(path: Path) -> Any:
    """Return a Dataset whose numbers are read from its file when they are looked at."""
    xarray = needed("xarray", "sweep")
    return xarray.open_dataset(path, engine=_ENGINES[path.suffix.lower()])


def attributes_in(path: Path) -> dict[str, Any]:
    """Return the attributes of the Dataset at a path; none where there is none."""
    if not path.exists():
        return {}
    try:
        with opened(path) as data:
            return dict(data.attrs)
    except (OSError, ValueError, KeyError):
        return {}


def _summary(sweep: Sweep, read: Read) -> tuple[dict[str, Any], int]:
    """Return what became of the points, as attributes, and how long the longest outcome is.

    Of outcomes that differ by their numbers alone the first is counted with the others.
    """
    met, width, kinds = 0, 1, dict[str, tuple[str, int]]()
    for chunk in range(sweep.chunks):
        good, outcomes = read(chunk, success(sweep.compute)), read(chunk, "outcome")
        met += int(good.sum())
        width = max(width, outcomes.dtype.itemsize // 4)
        for outcome in outcomes[~good].tolist():
            example, count = kinds.get(kind := _NUMBER.sub("#", outcome), (outcome, 0))
            kinds[kind] = (example, count + 1)
    failures = dict(sorted(kinds.values(), key=lambda item: -item[1]))
    return {"met": met, "failures": json.dumps(failures)}, width
