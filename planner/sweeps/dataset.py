"""A sweep as an xarray Dataset, in memory and as a file or folder that is there whole or not."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from model.errors import InputError
from planner.extras import needed
from planner.files import versions
from planner.sweeps.axes import Axis
from planner.sweeps.file import Sweep
from planner.sweeps.variables import VARIABLES, Rows

_LABELS = {
    "xyz": ["x", "y", "z"],
    "column": ["t", "n", "b"],
    "displacement": ["x", "y", "z", "turn_x", "turn_y", "turn_z"],
    "wrench": ["F_x", "F_y", "F_z", "M_x", "M_y", "M_z"],
}


def dataset(sweep: Sweep, rows: Rows) -> Any:
    """Return what a sweep has found as an xarray Dataset; MissingExtraError."""
    xarray = needed("xarray", "sweep")
    dims, shape = tuple(sweep.dims), tuple(sweep.dims.values())
    variables: dict[str, Any] = {}
    for name, own in VARIABLES[sweep.job.compute].items():
        values = rows.values[name].reshape(*shape, *rows.values[name].shape[1:])
        told = {"units": own.units, "long_name": own.about}
        variables[name] = ((*dims, *own.dims), values.astype(bool) if own.flag else values, told)
    outcomes = np.array(rows.outcomes, dtype=object).reshape(shape)
    variables["outcome"] = (dims, outcomes, {"long_name": "what happened"})
    coords = {axis.name: _coordinate(axis) for axis in sweep.axes}
    own_dims = {dim for own in VARIABLES[sweep.job.compute].values() for dim in own.dims}
    labels = {dim: text for dim, text in _LABELS.items() if dim in own_dims}
    labels["tendon"] = list(sweep.tendons)
    for dim, text in labels.items():
        coords[dim] = ((dim,), np.array(text, dtype=object), {})
    return xarray.Dataset(variables, coords, _attributes(sweep))


def _coordinate(axis: Axis) -> Any:
    is_text = any(isinstance(value, str) for value in axis.values)
    values = np.array(axis.values, dtype=object if is_text else None)
    told = {"key": axis.key, **({"units": axis.unit} if axis.unit else {})}
    return (("draw" if axis.drawn else axis.name,), values, told)


def _attributes(sweep: Sweep) -> dict[str, str]:
    told = {f"{name}_version": number for name, number in versions().items()}
    texts = {f"{name}_file": text for name, text in sweep.texts.items()}
    computed = {"compute": sweep.job.compute, "identity": sweep.identity}
    resolved = {"scene": msgspec.json.encode(sweep.job.scene).decode()}
    return {"title": "octoplan sweep", **computed, **told, **texts, **resolved}


def saver(path: Path) -> Callable[[Any], None]:
    """Return what saves a Dataset to a path, whole or not at all; .nc is NetCDF, .zarr is Zarr.

    Raises InputError for other names and where nothing can be written, MissingExtraError.
    """
    if path.suffix.lower() not in (".nc", ".zarr"):
        raise InputError("out", str(path), "a name that ends in .nc (NetCDF) or .zarr (Zarr)")
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise InputError("out", str(path), "a name in a folder that is there and can be written to")
    if path.suffix.lower() == ".nc":
        if path.is_dir():
            raise InputError("out", str(path), "a file: this is a folder")
        for package in ("h5netcdf", "h5py"):
            needed(package, "sweep")
        return lambda data: _whole(path, lambda new: data.to_netcdf(new, engine="h5netcdf"))
    if path.exists() and not path.is_dir():
        raise InputError("out", str(path), "a folder of Zarr: this is a file")
    needed("zarr", "zarr")
    # Texts are no settled part of Zarr's format 3 yet.
    return lambda data: _whole(path, lambda new: data.to_zarr(new, zarr_format=2))


def _whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write beside a path first, then put what is written in its place."""
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as staged:
            new, old = Path(staged) / path.name, Path(staged) / "old"
            write(new)
            if path.is_dir():
                # A folder cannot take the place of another at once.
                path.replace(old)
            new.replace(path)
    except OSError as reason:
        told = f"a place that can be written to: {(reason.strerror or str(reason)).lower()}"
        raise InputError("out", str(path), told) from None
