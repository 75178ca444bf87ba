"""What the equations of a loaded arm take from its cross-sections, as expressions of parameters.

Parameters p are the tensions at the motors (n_tendons,), the share of the loads that acts, and with
a probe a further dead force and moment (6,) there, in the base frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from model.arm import Arm
from model.integrators.runge_kutta import RungeKutta
from model.loaded.equations import LoadEquations
from model.loaded.loads import load_form, load_numbers
from model.paths import Array
from model.scene import Scene
from model.statics import loaded_statics_of
from model.stations import Counts, Stations, stations


@dataclass(frozen=True, eq=False)
class Sections:
    """What the equations take from N cross-sections: a column for each."""

    pull: ca.MX
    data: ca.DM
    pull_rate: ca.MX
    data_rate: ca.DM
    numbers: ca.MX

    @property
    def still(self) -> tuple[ca.MX, ca.DM, ca.MX]:
        """What is not a rate: pull, data, numbers."""
        return self.pull, self.data, self.numbers

    @property
    def all(self) -> tuple[ca.MX, ca.DM, ca.MX, ca.DM, ca.MX]:
        """Everything, in the order of LoadState.symbols."""
        return self.pull, self.data, self.pull_rate, self.data_rate, self.numbers


class LoadSections:
    """The cross-sections of an arm in a scene.

    Attributes
    ----------
    equations : LoadEquations
    probe : float or None
        Where a further force and moment may act [m].
    n_p : int
        Size of the parameters.
    """

    def __init__(
        self, arm: Arm, scene: Scene, scheme: RungeKutta, probe: float | None, lengths: bool
    ) -> None:
        self.arm, self.scene, self.scheme, self.probe = arm, scene, scheme, probe
        form = load_form(arm, scene, probe is not None, lengths)
        ends = tuple(i for i, _ in arm.tendons)
        self.equations = LoadEquations(loaded_statics_of(scene, arm), form, ends)
        self.n_p = arm.n_tendons + 1 + 6 * (probe is not None)

    def active(self, s: float) -> int:
        """Return how many sections' tendons cross just beyond s."""
        return sum(section.at > s for section in self.arm.sections)

    def reaches(self, s: float) -> bool:
        """Return whether the probe pulls on what is on the base side of s."""
        return self.probe is not None and s <= self.probe + 1e-9 * self.arm.length

    def moment(self, s: float, p: ca.MX) -> ca.MX:
        """Return the probe's moment if it acts at s, zero if it acts elsewhere."""
        if self.probe is None:
            return ca.MX(0, 1)
        here = abs(s - self.probe) <= 1e-9 * self.arm.length
        return p[-3:] if here else ca.MX.zeros(3)

    def sections(self, s: Array, active: Counts, beyond: float, p: ca.MX) -> Sections:
        """Return what the equations take from sections at s (N,).

        `active` (N,) sections cross there; loads from `beyond` on pull on them.
        """
        at = stations(self.arm, s, active)
        statics, n = self.equations.statics, self.arm.n_tendons
        T, share = p[:n], p[n]
        pulls = []
        for maps in statics.pulls(self.arm, at):
            if self.equations.n_tension:
                columns = np.transpose(maps, (2, 1, 0)).reshape(-1, s.size)
                pulls.append(ca.MX(ca.DM(columns)))
            else:
                flat = ca.sparsify(ca.DM(maps.reshape(-1, n)))
                pulls.append(ca.reshape(flat @ T, -1, s.size))
        data, data_rate = (ca.DM(values) for values in statics.data(at))
        return Sections(pulls[0], data, pulls[1], data_rate, self._numbers(at, beyond, share, p))

    def _numbers(self, at: Stations, beyond: float, share: ca.MX, p: ca.MX) -> ca.MX:
        rows = load_numbers(self.arm, self.scene, self.equations.form, at, beyond)
        scaled = ("force", "density", "drag", "mu")
        parts = [ca.DM(v) * share if name in scaled else ca.DM(v) for name, v in rows.items()]
        if self.reaches(beyond):
            parts[0] = parts[0] + ca.repmat(p[-6:-3], 1, at.s.size)
        return ca.vertcat(*parts) if parts else ca.MX(0, at.s.size)

    def step_data(
        self, start: Array, h: Array, active: Counts, beyond: float, p: ca.MX
    ) -> tuple[ca.MX | ca.DM, ...]:
        """Return what steps from start (N,) by h (N,) take from the sections at their nodes."""
        s = self._at(start, h)
        return self.sections(s, np.repeat(active, s.size // h.size), beyond, p).all

    def steps(self, nodes: Array, p: ca.MX) -> tuple[ca.MX | ca.DM, ...]:
        """Return what the steps of a segment take, from tip to base, and their lengths (1, N)."""
        h, active = np.diff(nodes), np.full(nodes.size - 1, self.active(nodes[:2].mean()))
        return (*self.step_data(nodes[:-1], h, active, nodes[0], p), ca.DM(h).T)

    def pull_slopes(self, nodes: Array) -> list[Array]:
        """Return the slopes of what varies with the tensions, as rate_derivatives.varied has it.

        (n_u, n_tendons) at each of the scheme's nodes in each step of a segment.
        """
        s, n = self._at(nodes[:-1], np.diff(nodes)), self.arm.n_tendons
        if self.equations.n_tension:
            return [np.zeros((0, n))] * s.size
        statics = self.equations.statics
        at = stations(self.arm, s, np.full(s.size, self.active(nodes[:2].mean())))
        maps, rates = statics.pulls(self.arm, at)
        return list(np.concatenate([maps, rates], axis=1) if statics.pull_varies else maps)

    def _at(self, start: Array, h: Array) -> Array:
        """Return the arc lengths of the scheme's nodes, step by step."""
        c = np.array(sorted(set(self.scheme.nodes)))
        return np.ravel(start[:, None] + h[:, None] * c)
