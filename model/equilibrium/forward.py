"""The forward map of a loaded scene on one mesh: tensions to states by collocation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.arm import Arm
from model.cross_section.reported import reported, strains_of
from model.cross_section.sections import Sections
from model.effects import ExactTendons, Extension, Friction
from model.equilibrium.dense import poses_and_strains
from model.equilibrium.linearised import Linearised
from model.equilibrium.load_stepping import equilibrium, near
from model.errors import UnsettledSectionError
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.stations import Counts
from model.transcription.collocation import gauss
from model.transcription.system import System, system
from model.transcription.terms import Places
from model.unloaded.closed_form import unloaded_strains

# Of an element, unless a scheme asks for fewer.
STAGES = 3


def collocation_order(stages: int, friction: bool) -> int:
    """Return the order that error estimates count on.

    One less with friction, where a fine mesh is needed to see it.
    """
    return 2 * stages - friction


@dataclass(frozen=True, eq=False)
class Known:
    """States of an equilibrium on some mesh."""

    system: System
    states: Array


class Collocation:
    """See ForwardMap; a row of its states is a node, then the stages of the element beyond it.

    Attributes
    ----------
    system : System
    stretch_at : (K,)
        Arc lengths of the stages, then of both ends of the elements [m].
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        stages: int,
        refinement: int,
        at: tuple[float, ...] = (),
        loaded: bool = True,
        machine_code: bool = False,
    ) -> None:
        self._state(system(arm, scene, stages, refinement, at, loaded, machine_code))

    @classmethod
    def on(cls, stated: System) -> Collocation:
        """Return the forward map of equations that are stated already."""
        found = cls.__new__(cls)
        found._state(stated)
        return found

    def _state(self, stated: System) -> None:
        self.system, self.mesh = stated, stated.mesh
        self.stretch_at = np.concatenate([stated.s, self.mesh.s[:-1], self.mesh.s[1:]])
        self.order = collocation_order(stated.of.form.stages, stated.scene.has(Friction))

    def run(self, tensions: Array, near: Known | None = None) -> tuple[Array, Array]:
        """See ForwardMap.run; raises SnapError and UnsettledSectionError."""
        return self.rows(self.found(tensions, near))

    def found(self, tensions: Array, known: Known | None = None) -> Linearised:
        """Return the equilibrium under tensions, near one that another mesh has, if any does."""
        if not is_loaded(self.system.scene):
            x = self.system.x(tensions, 1.0, self.without_loads(tensions))
            return Linearised.at(self.system, x)
        here = None if known is None else near(self.system, tensions, self.carried(tensions, known))
        return here or equilibrium(self.system, tensions, self.without_loads(tensions))

    def rows(self, here: Linearised) -> tuple[Array, Array]:
        """Return the states (N + 1, stride) of an equilibrium, and 1 + q (K,) at `stretch_at`."""
        of = self.system.of
        states = here.x[of.first :]
        padded = np.concatenate([states, np.zeros((of.elements + 1) * of.stride - states.size)])
        stages = reported(of.form.law, self.system.strains(states))[:, 3] + 1
        inside = stages.reshape(of.elements, -1)
        powers = gauss(of.form.stages).powers
        ends = [inside @ (float(x) ** np.arange(of.form.stages) @ powers) for x in (0, 1)]
        return padded.reshape(-1, of.stride), np.concatenate([stages, *ends])

    def states(self, rows: Array) -> Array:
        """Return the states (n_states,) of their rows; undoes rows."""
        return rows.ravel()[: self.system.of.n_states]

    def known(self, rows: Array) -> Known:
        """See ForwardMap.known."""
        return Known(self.system, self.states(rows))

    def without_loads(self, tensions: Array) -> Array:
        """Return the states under tensions without loads; raises UnsettledSectionError."""
        return self.system.start(tensions, self._settled_sections(tensions))

    def carried(self, tensions: Array, known: Known) -> Array:
        """Return the states of this mesh by the polynomials of another's strains."""
        mesh, form = known.system.mesh, known.system.of.form
        step = np.clip(np.searchsorted(mesh.s, self.system.s) - 1, 0, mesh.steps - 1)
        x = (self.system.s - mesh.s[step]) / np.diff(mesh.s)[step]
        stages = known.system.strains(known.states).reshape(-1, form.stages, form.strains)[step]
        basis = x[:, None] ** np.arange(form.stages) @ gauss(form.stages).powers
        return self.system.start(tensions, np.einsum("nm,nmk->nk", basis, stages), 1.0)

    def pulls(self, tensions: Array, rows: Array, s: Array, place: Places, tendon: Places) -> Array:
        """Return the tensions (P,) of tendons where they cross arc lengths s[place]."""
        x = self.system.x(tensions, 1.0, self.states(rows))
        return self.system.pulls(x, s, place, tendon)

    def dense(self, tensions: Array, rows: Array, s: Array) -> tuple[Array, Array]:
        """See ForwardMap.dense."""
        x = self.system.x(tensions, 1.0, self.states(rows))
        poses, v = poses_and_strains(self.system, x, s)
        nodes = np.minimum(np.searchsorted(self.mesh.s, s), self.mesh.steps)
        exact = (self.mesh.s[nodes] == s)[:, None]
        strains = reported(self.system.of.form.law, v)
        return np.where(exact, rows[nodes, :7], poses), strains

    def _settled_sections(self, tensions: Array) -> Array:
        """Return the strains at the stages without loads.

        Of an energy by Newton's method from those of the paper's balance; where that does not come
        to a minimum, by one that holds at any tension.
        """
        at, form = self.system, self.system.of.form
        active: Counts = np.repeat(self.mesh.active, form.stages)
        paper = Scene(Extension()) if form.law.extension else Scene()
        first = unloaded_strains(at.arm, paper, at.s, active, tensions)
        found = strains_of(form.law, first)
        if not at.scene.has(ExactTendons):
            return found
        sections = Sections(at.arm, at.scene, form.law, at.s, active)
        found, lost = sections.at_rest(found, tensions[sections.tendon])
        if lost.any():
            left = unloaded_strains(at.arm, at.scene, at.s[lost], active[lost], tensions)
            if np.isnan(left).any():
                raise UnsettledSectionError(float(at.s[lost][np.isnan(left).any(axis=1)][0]))
            found[lost] = strains_of(form.law, left)
        return found
