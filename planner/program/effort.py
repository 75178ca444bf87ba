"""What counts as effort: a norm of the tensions."""

from __future__ import annotations

from typing import Any, Literal

import casadi as ca
import numpy as np

from model.errors import InputError
from model.paths import Array

Norm = Literal["2", "1", "inf"]
NORMS: tuple[Norm, ...] = ("2", "1", "inf")


def effort(tensions: Array, norm: Norm) -> Array:
    """Return the norms (...) of tensions (..., n_tendons) [N]."""
    order = {"2": 2, "1": 1, "inf": np.inf}[norm]
    return np.asarray(np.linalg.norm(tensions, order, axis=-1))


def check_norm(norm: Any) -> Norm:
    """Return the norm by its name, or raise InputError."""
    if str(norm) not in NORMS:
        raise InputError(
            "norm", norm, "2 (least squares), 1 (least total pull) or inf (least maximum)"
        )
    return str(norm)  # type: ignore[return-value]


def smooth_norm(pull: ca.MX, norm: Norm) -> tuple[ca.MX, ca.MX, ca.MX]:
    """Return the objective, an extra unknown and its constraints: the norm made smooth."""
    empty = ca.MX(0, 1)
    if norm == "2":
        return ca.sumsqr(pull) / 2, empty, empty
    if norm == "1":
        return ca.sum1(pull), empty, empty
    peak = ca.MX.sym("peak")
    return peak, peak, peak - pull
