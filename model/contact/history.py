"""What friction knows of the motion before: where the arm was an equilibrium ago."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.equilibrium.dense import poses_and_strains
from model.equilibrium.linearised import Linearised
from model.paths import Array
from model.transcription.system import System
from model.transcription.touch import BEFORE, FRICTION


@dataclass(frozen=True, eq=False)
class History:
    """The equilibrium before, whose distance friction acts against."""

    here: Linearised

    def places(self, s: Array) -> Array:
        """Return where the midline was (n, 3) at arc lengths s (n,) [m]."""
        system, nodes = self.here.system, self.here.system.mesh.s
        near = np.minimum(np.searchsorted(nodes, s), nodes.size - 1)
        found, between = system.poses(self.here.states)[near, 4:], nodes[near] != s
        if between.any():
            found[between] = poses_and_strains(system, self.here.x, s[between])[0][:, 4:]
        return found

    def told(self, system: System) -> None:
        """Tell the kernels of friction of a system where its nodes were."""
        N, K = system.of.elements, system.of.form.contacts
        rows = system.p[system.of.equations.numbers_of("contact_friction")].reshape(N, K, FRICTION)
        rows[:, :, -BEFORE:] = self.places(system.mesh.s[1:])[:, None]
