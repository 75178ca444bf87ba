"""The forward map of a loaded scene on one mesh: tensions to states by collocation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.arm import Arm
from model.cross_section.reported import reported
from model.effects import Friction
from model.equilibrium.dense import poses_and_strains
from model.equilibrium.hold import TENSIONS, Hold
from model.equilibrium.linearised import Linearised
from model.equilibrium.load_stepping import at_once, by_load_steps, near
from model.equilibrium.sliding import pulls
from model.errors import SnapError, UnsettledSectionError
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.transcription.collocation import gauss
from model.transcription.kernel import Places
from model.transcription.system import System, system
from model.unloaded.settled_sections import settled_sections

# Of an element, unless a scheme asks for fewer.
STAGES = 3

# Steps in the loads that are soon done.
_SOON = 100
# Where a tendon has no length left any load moves it by many times the width that keeps its root
# smooth: steps in the loads shrink with that, and come to an end in a few or not at all.
_SOON_IF_CRUSHED = 30


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
        self.machine_code = stated.of.form.machine_code
        self._soon: tuple[Array, Linearised] | None = None
        self._unloaded: tuple[Array, Array] | None = None

    def run(self, tensions: Array, near: Known | None = None) -> tuple[Array, Array]:
        """See ForwardMap.run; raises SnapError and UnsettledSectionError."""
        return self.rows(self.found(tensions, near))

    def found(self, tensions: Array, known: Known | None = None) -> Linearised:
        """Return the equilibrium under tensions, near one that another mesh has, if any does."""
        if not is_loaded(self.system.scene):
            x = self.system.x(tensions, 1.0, self.without_loads(tensions))
            return Linearised(self.system, x)
        here = None if known is None else self.near(tensions, known)
        return here or self.from_rest(tensions)

    def found_soon(self, tensions: Array) -> Linearised:
        """Return the equilibrium from rest; raises SnapError where that takes many steps too.

        The last one is remembered: several things are asked of the same tensions.
        """
        if not is_loaded(self.system.scene):
            return self.found(tensions)
        last = self._soon
        if last is None or not np.array_equal(last[0], tensions):
            last = self._soon = tensions.copy(), self.from_rest(tensions, steps=_SOON)
        return last[1]

    def near(self, tensions: Array, known: Known, hold: Hold = TENSIONS) -> Linearised | None:
        """Return the equilibrium near one that another mesh has; None if there is none.

        Where lengths are held, `tensions` are those of that one.
        """
        return near(self.system, tensions, self.carried(tensions, known), hold)

    def from_rest(
        self, tensions: Array, hold: Hold = TENSIONS, steps: float = np.inf
    ) -> Linearised:
        """Return the equilibrium that the unloaded arm comes to.

        Raises SnapError as by_load_steps does, and UnsettledSectionError where tensions that leave
        a tendon no length keep loads from being applied in steps.
        """
        unloaded = self.without_loads(tensions)
        asked = (self.system, tensions, unloaded, hold)
        here = at_once(*asked)
        if here is not None:
            return here
        crushed = settled_sections(self.system).crushed(self.system.strains(unloaded))
        if not crushed.any():
            return by_load_steps(*asked, steps)
        try:
            return by_load_steps(*asked, min(steps, _SOON_IF_CRUSHED))
        except SnapError:
            raise UnsettledSectionError(float(self.system.s[np.argmax(crushed)])) from None

    def rows(self, here: Linearised) -> tuple[Array, Array]:
        """Return the states (N + 1, stride) of an equilibrium, and 1 + q (K,) at `stretch_at`."""
        of = self.system.of
        states = here.x[of.first :]
        padded = np.concatenate([states, np.zeros((of.elements + 1) * of.stride - states.size)])
        stages = reported(of.form.law, self.system.strains(states))[:, 3] + 1
        inside = stages.reshape(of.elements, -1)
        ends = [inside @ gauss(of.form.stages).at(x) for x in (0.0, 1.0)]
        return padded.reshape(-1, of.stride), np.concatenate([stages, *ends])

    def states(self, rows: Array) -> Array:
        """Return the states (n_states,) of their rows; undoes rows."""
        of = self.system.of
        return rows[:, : of.stride].ravel()[: of.n_states]

    def lengths(self, tensions: Array, rows: Array) -> Array:
        """Return the lengths of the tendons (n_tendons,) of states [m]."""
        return self.system.lengths(self.system.x(tensions, 1.0, self.states(rows)))

    def known(self, rows: Array) -> Known:
        """See ForwardMap.known."""
        return Known(self.system, self.states(rows))

    def without_loads(self, tensions: Array) -> Array:
        """Return the states under tensions without loads; raises UnsettledSectionError.

        The last ones are remembered.
        """
        at, last = self.system, self._unloaded
        if last is None or not np.array_equal(last[0], tensions):
            states = at.start(tensions, settled_sections(at).strains(tensions))
            last = self._unloaded = tensions.copy(), states
        return last[1].copy()

    def carried(self, tensions: Array, known: Known) -> Array:
        """Return the states of this mesh by the polynomials of another's strains."""
        before = known.system
        if before.of is self.system.of and np.array_equal(before.mesh.s, self.mesh.s):
            return known.states
        strains = carried_strains(before, before.strains(known.states), self.system)
        return self.system.start(tensions, strains, 1.0)

    def pulls(self, tensions: Array, rows: Array, s: Array, place: Places, tendon: Places) -> Array:
        """Return the tensions (P,) of tendons where they cross arc lengths s[place]."""
        x = self.system.x(tensions, 1.0, self.states(rows))
        return pulls(self.system, x, s, place, tendon)

    def dense(self, tensions: Array, rows: Array, s: Array) -> tuple[Array, Array]:
        """See ForwardMap.dense."""
        x = self.system.x(tensions, 1.0, self.states(rows))
        poses, v = poses_and_strains(self.system, x, s)
        nodes = np.minimum(np.searchsorted(self.mesh.s, s), self.mesh.steps)
        exact = (self.mesh.s[nodes] == s)[:, None]
        strains = reported(self.system.of.form.law, v)
        return np.where(exact, rows[nodes, :7], poses), strains


def carried_strains(before: System, strains: Array, after: System) -> Array:
    """Return the strains (N stages, ...) at the stages of a mesh by those of another's stages."""
    mesh, m = before.mesh, before.of.form.stages
    step = np.clip(np.searchsorted(mesh.s, after.s) - 1, 0, mesh.steps - 1)
    x = (after.s - mesh.s[step]) / np.diff(mesh.s)[step]
    by_element = strains.reshape(mesh.steps, m, *strains.shape[1:])
    return np.asarray(np.einsum("nm,nm...->n...", gauss(m).at(x), by_element[step]))
