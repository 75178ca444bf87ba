"""The tips of many sets of tensions under loads, on one mesh after the other."""

from __future__ import annotations

from typing import Any

import numpy as np

from model.arm import Arm
from model.cross_section.reported import reported, strains_of
from model.equilibrium.forward import carried_strains
from model.equilibrium.side_by_side import Found, from_rest, near
from model.paths import Array
from model.scene import Scene
from model.transcription.collocation import gauss
from model.transcription.layout import POSE
from model.transcription.system import System, system
from model.unloaded.settled_sections import settled_sections


class ManyTips:
    """Sets of tensions (M, n_tendons) [N] of a loaded arm, each with what its last mesh told."""

    def __init__(self, arm: Arm, T: Array, scene: Scene, stages: int) -> None:
        self.arm, self.T, self.scene, self.stages = arm, T, scene, stages
        self._on = np.zeros(len(T), int)
        self._strains: dict[int, Array] = {}

    def __call__(self, now: Any, refinement: int) -> tuple[Array, Array]:
        """Return tip poses (7, k) and the least 1 + q (k,) of sets; NaN where none is found.

        Raises CompilerError.
        """
        at = system(self.arm, self.scene, self.stages, refinement, machine_code=True)
        found = self._found(at, now)
        strains = found.states[np.ravel(at.of.stages)]
        kept = self._strains.setdefault(refinement, np.full((len(strains), len(self.T)), np.nan))
        kept[:, now], self._on[now] = strains, np.where(found.settled, refinement, 0)
        poses = found.states[at.of.nodes[-1, :POSE]]
        return np.where(found.settled, poses, np.nan), least_stretch(at, strains)

    def _found(self, at: System, now: Any) -> Found:
        """Return the equilibria near those of other meshes, else from the arm without loads."""
        T = self.T[now].T
        guesses = np.full((at.of.stages.size, len(now)), np.nan)
        for other in set(self._on[now].tolist()) - {0}:
            own = self._on[now] == other
            before = system(self.arm, self.scene, self.stages, other, machine_code=True)
            strains = self._strains[other][:, now[own]]
            strains = strains.reshape(-1, at.of.form.strains, strains.shape[1])
            guesses[:, own] = carried_strains(before, strains, at).reshape(len(guesses), -1)
        known = np.flatnonzero(self._on[now])
        states, settled = np.empty((at.of.n_states, len(now))), np.zeros(len(now), dtype=bool)
        if known.size:
            found = near(at, T[:, known], guesses[:, known])
            states[:, known], settled[known] = found
        left = np.flatnonzero(~settled)
        if left.size:
            found = from_rest(at, T[:, left], by_the_paper(at, T[:, left]))
            states[:, left], settled[left] = found
        return Found(states, settled)


def by_the_paper(at: System, T: Array) -> Array:
    """Return the strains (N stages strains, M) at the stages without loads, by its balance."""
    rows = settled_sections(at).by_the_paper.of_many(T.T)
    strains = strains_of(at.of.form.law, rows.reshape(-1, rows.shape[-1]))
    return np.asarray(strains.reshape(T.shape[1], -1).T)


def least_stretch(at: System, strains: Array) -> Array:
    """Return the least 1 + q (M,) at stages and ends of elements, of strains (N strains, M)."""
    of, M = at.of, strains.shape[1]
    m = of.form.stages
    rows = strains.T.reshape(-1, of.form.strains)
    stages = reported(of.form.law, rows)[:, 3].reshape(M, of.elements, m) + 1
    ends = stages @ gauss(m).at(np.array([0.0, 1.0])).T
    return np.asarray(np.minimum(stages.min(axis=(1, 2)), ends.min(axis=(1, 2))))
