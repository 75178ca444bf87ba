"""Equilibria of measured shapes: under the tensions of load cells, or by lengths of encoders."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import nnls

from model import OctoplanError, settle
from model.equilibrium.by_numbers import ByNumbers
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton_many
from model.paths import Array
from planner.fit.equilibria import Setting
from planner.fit.measured import Measured

# Corrections of tensions until lengths hold, and the change over the tensions that is none [N].
_CORRECTIONS, _HELD, _LEAST = 20, 1e-9, 1e-3
# Of the shapes whose tensions are corrected, tip error over arm length.
_ROUGHLY = 1e-4


def tensions_of(setting: Setting, shapes: Sequence[Measured]) -> Array:
    """Return the tensions of shapes (N, n_tendons) [N]; nan of those settled by lengths."""
    nothing = np.full(setting.system.arm.n_tendons, np.nan)
    rows = [nothing if shape.by_length else np.array(shape.tensions) for shape in shapes]
    return np.asarray(setting.numbers.scale * np.array(rows).reshape(-1, nothing.size))


def lengths_of(setting: Setting, shape: Measured) -> Array:
    """Return what winches leave of the tendons of a shape settled by lengths [m]."""
    if shape.lengths is not None:
        return np.array(shape.lengths)
    return np.asarray(setting.numbers.rest - np.array(shape.strokes))


def from_rest(setting: Setting, shapes: Sequence[Measured]) -> list[Linearised | OctoplanError]:
    """Return the equilibria of shapes as they are reached from rest, or why there is none."""
    tensions, lost = tensions_of(setting, shapes), dict[int, OctoplanError]()
    arm, scene = setting.system.arm, setting.system.scene
    for i, shape in enumerate(shapes):
        if shape.by_length:
            lengths = lengths_of(setting, shape)
            try:
                held = settle(arm, None, scene, _ROUGHLY, lengths=lengths)
                tensions[i] = arm.flat(held.tensions)
            except OctoplanError as reason:
                lost[i] = reason
    kept = [i for i in range(len(shapes)) if i not in lost]
    equilibria = dict(zip(kept, setting.from_rest(tensions[kept]), strict=True))
    reached = {i: here for i, here in equilibria.items() if isinstance(here, Linearised)}
    ends = _held(setting, [shapes[i] for i in reached], list(reached.values()))
    for i, here in zip(reached, ends, strict=True):
        equilibria[i] = here or OctoplanError("no shape near its lengths is found")
    return [lost.get(i) or equilibria[i] for i in range(len(shapes))]


def near(
    setting: Setting, shapes: Sequence[Measured], before: Sequence[ByNumbers], change: Array
) -> list[Linearised | None]:
    """Return the equilibria of shapes near those before a change (K,), as Setting.near."""
    tensions = tensions_of(setting, shapes)
    ahead = np.array([by.here.tensions + by.tensions @ change for by in before])
    tensions = np.where(np.isnan(tensions), np.maximum(ahead, 0.0), tensions)
    return _held(setting, shapes, setting.near(tensions, before, change))


def differentiated(
    setting: Setting, shapes: Sequence[Measured], heres: Sequence[Linearised]
) -> list[ByNumbers]:
    """Return the derivatives of equilibria of shapes by the unknowns.

    With those of the tensions that lengths hold.
    """
    numbers, n = setting.derivatives, setting.system.arm.n_tendons
    measured = [np.zeros(n) if own.by_length else np.array(own.tensions) for own in shapes]
    rows = setting.differentiated(heres, [T[:, None] * numbers.scale for T in measured])
    for i, (shape, by) in enumerate(zip(shapes, rows, strict=True)):
        if shape.by_length:
            left = numbers.rest if shape.strokes is not None else 0.0
            tensions = tensions_by_lengths(by.here) @ (left - by.lengths)
            rows[i] = ByNumbers(by.here, by.jacobian, tensions, by.moved)
    return rows


def tensions_by_lengths(here: Linearised) -> Array:
    """Return how tensions change with the lengths that winches leave (n_tendons, n_tendons)."""
    taut = here.tensions > 0
    inverse = np.zeros((taut.size, taut.size))
    inverse[np.ix_(taut, taut)] = np.linalg.pinv(here.length_tension[np.ix_(taut, taut)], 1e-9)
    return inverse


def _held(
    setting: Setting, shapes: Sequence[Measured], heres: Sequence[Linearised | None]
) -> list[Linearised | None]:
    """Return equilibria with those settled by lengths corrected until these hold.

    A tendon is taut, its length as the winch leaves it, or slack, its tension 0: the Newton
    correction of all tensions is a linear complementarity problem, whose matrix, how lengths shrink
    with tensions, is symmetric and positive semidefinite for tendons without friction: least
    squares under bounds.
    """
    kept = list(heres)
    left = [i for i, shape in enumerate(shapes) if shape.by_length and kept[i] is not None]
    for _ in range(_CORRECTIONS):
        going: dict[int, tuple[Array, Array]] = {}
        for i in left:
            here = kept[i]
            assert here is not None
            root = _root(-here.length_tension)
            excess = here.lengths - lengths_of(setting, shapes[i])
            goal = root @ here.tensions + np.linalg.lstsq(root.T, excess, rcond=1e-9)[0]
            new, _ = nnls(root, goal)
            if np.abs(new - here.tensions).max() > _HELD * max(_LEAST, new.max()):
                going[i] = new, here.states + here.by_tensions @ (new - here.tensions)
        if not going:
            return kept
        T, states = (np.array(rows) for rows in zip(*going.values(), strict=True))
        solutions = newton_many(setting.system, T, 1.0, states).solutions
        for i, end in zip(going, solutions, strict=True):
            kept[i] = end
        left = [i for i in going if kept[i] is not None]
    return [None if i in left else here for i, here in enumerate(kept)]


def _root(A: Array) -> Array:
    """Return the symmetric root of the symmetric part of a matrix, negative eigenvalues cut."""
    eigenvalues, V = np.linalg.eigh((A + A.T) / 2)
    return np.asarray((V * np.sqrt(np.maximum(eigenvalues, 0.0))) @ V.T)
