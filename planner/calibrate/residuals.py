"""Residuals by shape and marker."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from model.paths import Array
from planner.calibrate.experiment import Evaluation
from planner.calibrate.measured import Measured


class Residual(NamedTuple):
    """What is predicted less what was measured of one thing of a shape.

    `what` is a marker ("points[1]"), "tip", a frame or a tendon; `miss` in m, of frames in rad.
    """

    shape: str
    what: str
    miss: tuple[float, ...]

    @property
    def size(self) -> float:
        """The distance [m], or angle [rad]."""
        return float(np.linalg.norm(self.miss))

    @property
    def is_place(self) -> bool:
        """Whether it is a marker's or the tip's."""
        return self.what.startswith(("points", "tip"))


def residuals_of(found: Evaluation) -> tuple[Residual, ...]:
    """Return all residuals of an evaluation, shape by shape."""
    rows: list[Residual] = []
    for shape, miss in zip(found.experiment.shapes, found.by_shape, strict=True):
        rows += [Residual(shape.name, what, tuple(own)) for what, own in _parts(shape, miss)]
    return tuple(rows)


def mean_distance(residuals: Iterable[Residual]) -> float:
    """Return the mean distance of markers and tips from where they are predicted [m], or NaN."""
    sizes = [own.size for own in residuals if own.is_place]
    return float(np.mean(sizes)) if sizes else float("nan")


def _parts(shape: Measured, miss: Array) -> list[tuple[str, list[float]]]:
    """Return the residuals (size,) of a shape by what was measured."""
    names = [f"points[{i}]" for i, _ in shape.seen] + ["tip"] * (shape.tip is not None)
    names += [f"frames[{i}]" for i in range(len(shape.frames))]
    runs = [
        f"{k}[{j}]" for k in ("lengths", "strokes") for j in range(len(getattr(shape, k) or ()))
    ]
    vectors = miss[: 3 * len(names)].reshape(-1, 3).tolist()
    rest = miss[3 * len(names) :].reshape(-1, 1).tolist()
    return [*zip(names, vectors, strict=True), *zip(runs, rest, strict=True)]
