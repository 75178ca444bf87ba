"""The poses of many arms at once, for scenes whose strains are in closed form.

Interpreted, NumPy takes the operations of a step for all steps and arms side by side, then those of
the chain for all arms; in machine code the C of model/machine/tips.c takes a few arms at a time.
Digits are those of the forward map.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from model.integrators.magnus import Magnus
from model.machine.buffered import Buffered, Mapped
from model.machine.program import Program
from model.machine.tips import NodeNumbers, PosesInC
from model.paths import Array
from model.stations import Counts, base_pose, stations
from model.unloaded.closed_form import (
    ClosedForm,
    step_function,
    strain_function,
)
from model.unloaded.geometry import nodes_of
from model.unloaded.pulls import TERMS, PullPolynomials
from model.unloaded.statics import ClosedStatics, closed_statics
from model.unloaded.step_twist import chain_function

# Columns at a time, so that the registers stay in the processor's cache.
_COLUMNS = 3072
# Below so many arms CasADi's interpreter is sooner done with the same operations.
_FEW = 32


class Batch:
    """The steps of a closed form as tables of numbers.

    Attributes
    ----------
    active, basis, data, h
        For S steps from base to tip: sections that cross (S,), (S, TERMS, m), (S, m n_data), (S,).
    end_active, end_basis, end_data
        The same for the ends of segments, where only 1 + q is looked at, with m = 1.
    """

    def __init__(self, forward: ClosedForm, polynomials: PullPolynomials) -> None:
        arm, mesh = forward.arm, forward.mesh
        self.forward, self.scheme, self.polynomials = forward, forward.scheme, polynomials
        self.statics, self.base = closed_statics(forward.scene, arm), base_pose(arm)
        m, inner = len(forward.scheme.nodes), nodes_of(forward.scheme, mesh.s[:-1], mesh.s[1:])
        ends, count = mesh.segment_ends()
        self.h = np.diff(mesh.s)
        self.active, self.basis, self.data = self._table(inner, mesh.active, m)
        self.end_active, self.end_basis, self.end_data = self._table(ends, count, 1)

    def _table(self, s: Array, active: Counts, m: int) -> tuple[Counts, Array, Array]:
        data = self.statics.data(stations(self.forward.arm, s, np.repeat(active, m)))
        basis = self.polynomials.basis(s).reshape(TERMS, -1, m).transpose(1, 0, 2)
        columns = data.T.reshape(active.size, -1)
        return _whole(active), np.ascontiguousarray(basis), np.ascontiguousarray(columns)

    def poses(self, tensions: Array, nodes: NodeNumbers) -> tuple[Array, Array]:
        """Return poses (K, 7, M) and the least 1 + q (M,) for tensions (n_tendons, M).

        At nodes (K,) from the base on; 1 + q is NaN where a section has no equilibrium. By machine
        code if the forward map is. Raises CompilerError.
        """
        if self.forward.machine_code:
            return self._in_c(tensions, nodes)
        if tensions.shape[1] < _FEW:
            return self._few(tensions, nodes)
        cuts = range(0, tensions.shape[1], _COLUMNS)
        parts = [self._interpreted(tensions[:, i : i + _COLUMNS], nodes) for i in cuts]
        poses = np.concatenate([found for found, _ in parts], axis=2)
        return poses, np.concatenate([low for _, low in parts])

    @cached_property
    def _in_c(self) -> PosesInC:
        step, stretch = step_function(self.statics, self.scheme), stretch_function(self.statics)
        return PosesInC(self, (step, chain_function(), stretch))

    def _few(self, T: Array, nodes: NodeNumbers) -> tuple[Array, Array]:
        step, stretch, chain = _by_casadi(self.statics, self.scheme, self.h.size)
        carried, M = self._carried(T), T.shape[1]

        def columns(active: Counts, basis: Array, data: Array) -> tuple[Array, Array]:
            pull = _pull(carried[active], basis).transpose(2, 1, 0).reshape(M * active.size, -1)
            return pull, np.tile(data, (M, 1))

        inner = columns(self.active, self.basis, self.data)
        relative, stretched = step(*inner, np.tile(self.h, M))
        (at_ends,) = stretch(*columns(self.end_active, self.end_basis, self.end_data))
        poses = np.empty((M, self.h.size + 1, 7))
        poses[:, 0] = self.base
        for own, along in zip(poses, relative.reshape(M, -1), strict=True):
            own[1:] = chain(self.base, along)[0]
        low = np.minimum(stretched.reshape(M, -1).min(axis=1), at_ends.reshape(M, -1).min(axis=1))
        return poses[:, nodes].transpose(1, 2, 0), low

    def _interpreted(self, T: Array, nodes: NodeNumbers) -> tuple[Array, Array]:
        step, chain, stretch = _programs(self.statics, self.scheme)
        M, m, S, ends = T.shape[1], len(self.scheme.nodes), self.h.size, self.end_active.size
        carried = self._carried(T)
        relative, stretched = np.empty((7, S, M)), np.empty((m, S, M))
        at_once = max(1, _COLUMNS // M)
        room = np.empty((max(step.n_registers, stretch.n_registers), max(at_once, ends), M))
        for k in range(0, S, at_once):
            rows = slice(k, min(k + at_once, S))
            pull = _pull(carried[self.active[rows]], self.basis[rows])
            given = [pull, self.data[rows].T[:, :, None], self.h[None, rows, None]]
            results = [relative[:, rows], stretched[:, rows]]
            step.run(given, results, room[:, : results[0].shape[1]])
        poses = np.empty((S + 1, 7, M))
        poses[0] = self.base[:, None]
        for k in range(S):
            chain.run([poses[k], relative[:, k]], [poses[k + 1]], room[:, 0])
        at_ends = np.empty((1, ends, M))
        pull = _pull(carried[self.end_active], self.end_basis)
        stretch.run([pull, self.end_data.T[:, :, None]], [at_ends], room[:, :ends])
        return poses[nodes], np.minimum(stretched.min(axis=(0, 1)), at_ends.min(axis=(0, 1)))

    def _carried(self, T: Array) -> Array:
        """Return coefficients (sections + 1, TERMS, n_pull, M) where 0, 1, .. sections cross."""
        found, start = [np.zeros((TERMS, self.statics.n_pull, T.shape[1]))], 0
        for own in self.polynomials.own:
            added = np.zeros((own.shape[0], T.shape[1]))
            for j in range(own.shape[1]):
                added += own[:, j, None] * T[start + j]
            found.append(found[-1] + added.reshape(found[-1].shape))
            start += own.shape[1]
        return np.array(found)


def _whole(values: Counts) -> Any:
    return values.astype(np.int32)


def _pull(carried: Array, basis: Array) -> Array:
    """Return pull (m n_pull, k, M) from carried (k, TERMS, n_pull, M) and basis (k, TERMS, m).

    Summed in the order of model/machine/tips.c.
    """
    first, second, third = (
        carried[:, i].transpose(1, 0, 2) * basis[:, i].T[:, None, :, None] for i in range(TERMS)
    )
    total = first + second + third
    return np.asarray(total.reshape(-1, *total.shape[2:]))


@lru_cache(maxsize=64)
def stretch_function(statics: ClosedStatics) -> ca.Function:
    """Return (pull, data) -> 1 + q."""
    pull, data = ca.SX.sym("pull", statics.n_pull), ca.SX.sym("data", statics.n_data)
    stretch = 1 + strain_function(statics)(pull, data)[3]
    return ca.Function("stretch", [pull, data], [stretch], {"cse": True})


@lru_cache(maxsize=64)
def _by_casadi(
    statics: ClosedStatics, scheme: Magnus, steps: int
) -> tuple[Mapped, Mapped, Buffered]:
    """Return a step and 1 + q for many places, and the chain along so many steps."""
    mapped = Mapped(step_function(statics, scheme)), Mapped(stretch_function(statics))
    return *mapped, Buffered(chain_function().mapaccum(steps))


@lru_cache(maxsize=64)
def _programs(statics: ClosedStatics, scheme: Magnus) -> tuple[Program, Program, Program]:
    functions = step_function(statics, scheme), chain_function(), stretch_function(statics)
    return Program(functions[0]), Program(functions[1]), Program(functions[2])
