"""The strains of cross-sections under tensions alone, in numbers: one solver for any tension.

Without loads the wrench of body and tendons vanishes at each cross-section by itself. The paper's
balance is linear in its strains; with an energy they are found by the steps of
model.unloaded.energy_statics, for all cross-sections side by side, until the last of them is
settled: four to seven steps for ordinary tensions, thirty for a thousand times as much.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from model.arm import Arm
from model.effects import ExactTendons, Extension, NeoHookean
from model.machine.buffered import Buffered
from model.machine.compiled import kernel
from model.paths import Array
from model.scene import Scene
from model.stations import Counts, stations
from model.unloaded.energy_statics import EnergyStatics
from model.unloaded.statics import ClosedStatics, closed_statics

# Steps at most.
_STEPS = 40
# Cross-sections side by side, and of which counts of them functions are made.
_MOST, _COUNTS = 512, 8


def unloaded(scene: Scene) -> Scene:
    """Return the scene with what a section settles by itself, and nothing else."""
    kept = (Extension, ExactTendons, NeoHookean)
    return Scene(*(effect for effect in scene.effects if isinstance(effect, kept)))


class SectionSolver:
    """Tensions to the strains of an arm's cross-sections at s (N,) where loads are left out.

    `active` (N,) sections' tendons cross there. Strains are those of the law of the statics.
    """

    def __init__(
        self, arm: Arm, scene: Scene, s: Array, active: Counts, machine_code: bool = False
    ) -> None:
        self.statics, at = closed_statics(unloaded(scene), arm), stations(arm, s, active)
        self._maps, self._data = self.statics.pulls(arm, at), self.statics.data(at).T
        self._machine_code = machine_code

    def strains(self, tensions: Array) -> Array:
        """Return the strains (N, n) under tensions (n_tendons,); NaN where none balance."""
        return settled(self.statics, self._maps @ tensions, self._data, self._machine_code)

    def of_many(self, tensions: Array) -> Array:
        """Return the strains (M, N, n) under tensions (M, n_tendons); NaN where none balance."""
        pulls = np.einsum("nij,mj->mni", self._maps, tensions)
        data = np.broadcast_to(self._data, (len(tensions), *self._data.shape))
        pull, each = (part.reshape(-1, part.shape[-1]) for part in (pulls, data))
        found = settled(self.statics, pull, each, self._machine_code)
        return found.reshape(*pulls.shape[:2], -1)


def settled(statics: ClosedStatics, pull: Array, data: Array, machine_code: bool = False) -> Array:
    """Return the strains (N, n) of pull (N, n_pull) and data (N, n_data); NaN where none are."""
    N = len(pull)
    if N > _MOST:
        cuts = [slice(i, i + _MOST) for i in range(0, N, _MOST)]
        parts = [settled(statics, pull[cut], data[cut], machine_code) for cut in cuts]
        return np.concatenate(parts)
    lacking = -N % _COUNTS
    if lacking:
        pull, data = (np.concatenate([v, v[-1:].repeat(lacking, axis=0)]) for v in (pull, data))
    return solver(statics, len(pull), machine_code)(pull, data)[:N]


class _Solver:
    """(pull (N, n_pull), data (N, n_data)) -> strains (N, n), of so many cross-sections."""

    def __init__(self, statics: ClosedStatics, count: int, machine_code: bool) -> None:
        self._settled = getattr(statics, "settled", np.inf)
        begin, *step = (Buffered(kernel(f, machine_code).map(count)) for f in _functions(statics))
        self._begin, self._step = begin, step[0] if step else None

    def __call__(self, pull: Array, data: Array) -> Array:
        given = pull.ravel(), data.ravel()
        if self._step is None:
            return self._begin(*given)[0]
        u, w = self._begin(*given)
        for _ in range(_STEPS):
            u, w, size, v = self._step(u.ravel(), w.ravel(), *given)
            if not (size >= self._settled).any():  # what is no number stays so
                break
        return np.where(size < self._settled, v, np.nan)


@lru_cache(maxsize=96)
def solver(statics: ClosedStatics, count: int, machine_code: bool = False) -> _Solver:
    """Return what settles so many cross-sections, made once."""
    return _Solver(statics, count, machine_code)


@lru_cache(maxsize=24)
def _functions(statics: ClosedStatics) -> tuple[ca.Function, ...]:
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    if isinstance(statics, EnergyStatics):
        return statics.begun, statics.step
    return (ca.Function("settled", [pull, data], [statics.solve(pull, data)], {"cse": True}),)
