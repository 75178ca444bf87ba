"""What a sweep has found as an xarray Dataset, with units and what it was made from."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from model.extras import needed
from planner.files import versions
from planner.sweeps.axes import Axis
from planner.sweeps.definition import Sweep
from planner.sweeps.values import Listed
from planner.sweeps.variables import VARIABLES, Rows

_LABELS = {
    "xyz": ["x", "y", "z"],
    "column": ["t", "n", "b"],
    "displacement": ["x", "y", "z", "rotation_x", "rotation_y", "rotation_z"],
    "wrench": ["F_x", "F_y", "F_z", "M_x", "M_y", "M_z"],
}


def dataset(sweep: Sweep, rows: Rows, *, first: bool = False) -> Any:
    """Return rows of all points, or of the first alone, as a Dataset; MissingExtraError."""
    xarray = needed("xarray", "sweep")
    sizes = {dim: 1 if first else size for dim, size in sweep.dims.items()}
    dims, shape = tuple(sizes), tuple(sizes.values())
    variables: dict[str, Any] = {}
    for name, own in VARIABLES[sweep.job.compute].items():
        values = rows.values[name].reshape(*shape, *rows.values[name].shape[1:])
        told = {"units": own.units, "long_name": own.about}
        variables[name] = ((*dims, *own.dims), values.astype(bool) if own.flag else values, told)
    outcomes = np.array(rows.outcomes, dtype=object).reshape(shape)
    variables["outcome"] = (dims, outcomes, {"long_name": "what happened"})
    coords: dict[str, Any] = {}
    for axis in sweep.axes:
        dim = sweep.dim(axis)
        told = {"key": axis.key, **({"units": axis.unit} if axis.unit else {})}
        coords[axis.name] = ((dim,), coordinate(axis, 0, sizes[dim]), told)
    own_dims = {dim for own in VARIABLES[sweep.job.compute].values() for dim in own.dims}
    labels = {dim: text for dim, text in _LABELS.items() if dim in own_dims}
    labels["tendon"] = list(sweep.tendons)
    for dim, text in labels.items():
        coords[dim] = ((dim,), np.array(text, dtype=object), {})
    return xarray.Dataset(variables, coords, _attributes(sweep))


def coordinate(axis: Axis, begin: int, end: int) -> Any:
    """Return the values of an axis from one place to another (end - begin,)."""
    kind: Any = float
    if isinstance(axis.values, Listed):
        is_text = isinstance(axis.values.values[0], str)
        kind = object if is_text else np.array(axis.values.values).dtype
    return np.array(axis.values.at(np.arange(begin, end)), dtype=kind)


def _attributes(sweep: Sweep) -> dict[str, str]:
    told = {f"{name}_version": number for name, number in versions().items()}
    texts = {f"{name}_file": text for name, text in sweep.texts.items()}
    computed = {"compute": sweep.job.compute, "identity": sweep.identity}
    resolved = {"scene": msgspec.json.encode(sweep.job.scene).decode()}
    return {"title": "octoplan sweep", **computed, **told, **texts, **resolved}
