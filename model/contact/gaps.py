"""Gaps of the nodes to the obstacles, and how these move with the states."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from model.machine.buffered import Mapped
from model.machine.compiled import kernel
from model.paths import Array
from model.transcription.element import Form
from model.transcription.layout import POSE
from model.transcription.system import System
from model.transcription.touch import TOUCH, gap_function


@dataclass(frozen=True, eq=False)
class Gaps:
    """Of all nodes but the base to K obstacles.

    Attributes
    ----------
    gap, slope : (N, K)
        Gap [m], and its derivative along s [-] on the base side of the node.
    normal : (N, K, 3)
        Out of the obstacle.
    """

    system: System
    gap: Array
    slope: Array
    normal: Array
    by_strains: Array

    @classmethod
    def of(cls, system: System, states: Array) -> Gaps:
        """Return those of states (n_states,)."""
        of, form = system.of, system.of.form
        N, K = of.elements, form.contacts
        numbers = system.p[of.equations.numbers_of("touch")].reshape(N * K, TOUCH)
        inside = np.repeat(states[of.stages].reshape(N, -1), K, axis=0)
        poses = np.repeat(states[of.nodes[1:, :POSE]], K, axis=0)
        found = _gaps(form)(inside, poses, numbers)
        gap, slope, normal, by_strains = (part.reshape(N, K, -1) for part in found)
        return cls(system, gap[:, :, 0], slope[:, :, 0], normal, by_strains)

    def moved(self, change: Array) -> Array:
        """Return how much gaps grow (N, K, ...) with changes of the states (n_states, ...)."""
        of = self.system.of
        by_place = np.einsum("nki,ni...->nk...", self.normal, change[of.nodes[1:, 4:POSE]])
        bent = change[of.stages].reshape(of.elements, -1, *change.shape[1:])
        return np.asarray(by_place + np.einsum("nki,ni...->nk...", self.by_strains, bent))


@lru_cache(maxsize=32)
def _gaps(form: Form) -> Mapped:
    """Return gap_function of many nodes at once."""
    return Mapped(kernel(gap_function(form.law, form.stages), form.machine_code))
