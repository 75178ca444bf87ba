"""The chunks of a sweep gathered in an xarray Dataset, with units and what it was made from.

Dask reads, block by block, what xarray writes, so that memory holds a block only.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from model.errors import InputError
from model.extras import needed
from model.progress import tell
from model.time_limit import check_time
from planner.io.files import staged, versions, why
from planner.sweeps.chunk_files import FullDiskError
from planner.sweeps.definition import Sweep, box_sizes
from planner.sweeps.variables import LABELS, VARIABLES, Rows, blank, dtype_of, success

Read = Callable[[int], Rows]
# Points that are read and written at a time, and lie together in a Zarr folder.
_BLOCK = 1000
_ENGINES = {".nc": "h5netcdf", ".zarr": "zarr"}
_NUMBER = re.compile(r"-?\d[\d.]*(e[+-]?\d+)?")


def gathered(sweep: Sweep, read: Read) -> Any:
    """Return the Dataset of a sweep, all of whose chunks can be read; it is read when looked at."""
    xarray = needed("xarray", "sweep")
    summary, width = _summary(sweep, read)
    dims, variables = tuple(sweep.dims), dict[str, Any]()
    for name, array in _arrays(sweep, read, width).items():
        own = VARIABLES[sweep.compute][name]
        units = {"units": own.units} if own.units else {}
        variables[name] = ((*dims, *own.dims), array, {**units, "long_name": own.about})
    coords: dict[str, Any] = {}
    for axis in sweep.axes:
        attributes = {"key": axis.key, **({"units": axis.unit} if axis.unit else {})}
        coords[axis.name] = (("draw" if axis.drawn else axis.name,), axis.values, attributes)
    used = {dim for own in VARIABLES[sweep.compute].values() for dim in own.dims}
    labels = {**LABELS, "tendon": list(sweep.tendons)}
    coords |= {dim: ((dim,), text, {}) for dim, text in labels.items() if dim in used}
    return xarray.Dataset(variables, coords, _attributes(sweep) | summary)


def save(data: Any, path: Path) -> None:
    """Write a Dataset to a path, whole or not at all; raises FullDiskError."""
    try:
        with staged(path.parent) as folder:
            new, old = folder / f"new{path.suffix.lower()}", folder / "old"
            with in_order():
                if path.suffix.lower() == ".nc":
                    data.to_netcdf(new, engine="h5netcdf")
                else:
                    # Texts are no settled part of Zarr's format 3 yet.
                    data.to_zarr(new, zarr_format=2, consolidated=True)
            if path.is_dir():
                # A folder cannot take the place of another at once.
                path.replace(old)
            new.replace(path)
    except OSError as reason:
        raise FullDiskError(str(path), why(reason)) from None


@contextmanager
def in_order() -> Iterator[None]:
    """Let Dask compute block after block, so that memory holds one."""
    with needed("dask", "sweep").config.set(scheduler="synchronous"):
        yield


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


def _arrays(sweep: Sweep, read: Read, width: int) -> dict[str, Any]:
    """Return each variable as an array of Dask's, whose blocks are some chunks each."""
    da, delayed = needed("dask.array", "sweep"), needed("dask", "sweep").delayed
    together = box_sizes(sweep.counts, max(_BLOCK // math.prod(sweep.chunk), 1))
    numbers = np.arange(sweep.chunks).reshape(sweep.counts)
    blocks = [range(0, n, m) for n, m in zip(sweep.counts, together, strict=True)]
    variables = VARIABLES[sweep.compute]
    arrays = {name: np.empty([len(own) for own in blocks], object) for name in variables}
    for place in np.ndindex(*(len(own) for own in blocks)):
        begins = [own[i] for own, i in zip(blocks, place, strict=True)]
        inside = tuple(slice(i, i + m) for i, m in zip(begins, together, strict=True))
        block = partial(_block, sweep, read, width, numbers[inside])
        rows, sizes = delayed(block, pure=False)(), _box_around(sweep, numbers[inside])[1]
        for name, own in variables.items():
            shape = (*sizes, *own.sizes(len(sweep.tendons)))
            arrays[name][place] = da.from_delayed(rows[name], shape, dtype_of(own, width))
    return {name: _joined(da, own) for name, own in arrays.items()}


def _joined(da: Any, blocks: Any, axis: int = 0) -> Any:
    """Return the array that blocks make whose places are those of an array of objects."""
    if not isinstance(blocks, np.ndarray):
        return blocks
    return da.concatenate([_joined(da, own, axis + 1) for own in blocks], axis)


def _box_around(sweep: Sweep, chunks: Any) -> tuple[list[int], tuple[int, ...]]:
    """Return where the box begins that chunks fill, and its sizes."""
    first, last = (sweep.box(int(chunks.flat[i])) for i in (0, -1))
    begin = [own.start for own in first]
    return begin, tuple(b.stop - a for a, b in zip(begin, last, strict=True))


def _block(sweep: Sweep, read: Read, width: int, chunks: Any) -> Rows:
    """Return the variables of some chunks, that fill a box (sizes of the box, its own sizes)."""
    check_time()
    begin, sizes = _box_around(sweep, chunks)
    rows = blank(sweep.compute, len(sweep.tendons), math.prod(sizes), width)
    block = {name: own.reshape(*sizes, *own.shape[1:]) for name, own in rows.items()}
    for chunk in chunks.flat:
        box = sweep.box(int(chunk))
        inside = tuple(slice(b.start - a, b.stop - a) for a, b in zip(begin, box, strict=True))
        for name, own in read(int(chunk)).items():
            block[name][inside] = own.reshape(block[name][inside].shape)
    tell("chunks gathered", int(chunks.flat[-1]) + 1, sweep.chunks)
    return block


def _summary(sweep: Sweep, read: Read) -> tuple[dict[str, Any], int]:
    """Return what became of the points, as attributes, and how long the longest outcome is.

    Of outcomes that differ by their numbers alone the first is counted with the others.
    """
    met, width, kinds = 0, 1, dict[str, tuple[str, int]]()
    for chunk in range(sweep.chunks):
        rows = read(chunk)
        good, outcomes = rows[success(sweep.compute)], rows["outcome"]
        met += int(good.sum())
        width = max(width, outcomes.dtype.itemsize // 4)
        for outcome in outcomes[~good].tolist():
            example, count = kinds.get(kind := _NUMBER.sub("#", outcome), (outcome, 0))
            kinds[kind] = (example, count + 1)
    failures = dict(sorted(kinds.values(), key=lambda item: -item[1]))
    return {"met": met, "failures": json.dumps(failures)}, width


def _attributes(sweep: Sweep) -> dict[str, str]:
    numbers = {f"{name}_version": number for name, number in versions().items()}
    texts = {f"{name}_file": text for name, text in sweep.texts.items()}
    computed = {"compute": sweep.compute, "identity": sweep.identity}
    resolved = {"scene": msgspec.json.encode(sweep.scene).decode()}
    return {"title": "octoplan sweep", **computed, **numbers, **texts, **resolved}
