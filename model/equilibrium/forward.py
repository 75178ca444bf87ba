"""The forward map of a loaded scene on one mesh: tensions to states by collocation."""

from __future__ import annotations

import numpy as np

from model.arm import Arm
from model.equilibrium.equilibrium import Collocated, Equilibrium
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import (
    LEAST_STEP,
    NEAR,
    SNAPS,
    Followed,
    follow_on,
    newton,
)
from model.errors import SnapError, UnsettledSectionError
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.transcription.collocation import gauss
from model.transcription.system import System, system
from model.unloaded.sections import unloaded_sections

# Of an element, unless a scheme asks for fewer.
STAGES = 3

# Where a tendon has no length left any load moves it by many times the width that keeps its root
# smooth: steps in the loads shrink with that, and come to an end in a few or not at all.
_SOON_IF_CRUSHED = 30


def collocation_order(stages: int, friction: bool) -> int:
    """Return the order that error estimates count on.

    One less with friction, where a fine mesh is needed to see it.
    """
    return 2 * stages - friction


class Collocation:
    """The equations of an arm on a mesh, which settle tensions to equilibria.

    Attributes
    ----------
    system : System
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
        self.refinement = refinement
        self._state(system(arm, scene, stages, refinement, at, loaded, machine_code))

    @classmethod
    def on(cls, stated: System) -> Collocation:
        """Return the forward map of equations that are stated already."""
        result = cls.__new__(cls)
        result.refinement = 0
        result._state(stated)
        return result

    def _state(self, stated: System) -> None:
        self.system, self.mesh = stated, stated.mesh
        self.machine_code = stated.of.form.machine_code

    def equilibrium(self, tensions: Array, near: Equilibrium | None = None) -> Collocated:
        """Return the equilibrium under tensions, near that of another mesh if given."""
        known = None if near is None else near.states
        return Collocated(self.solve(tensions, known), self.refinement)

    def solve(self, tensions: Array, known: Linearised | None = None) -> Linearised:
        """Return the equilibrium under tensions (n_tendons,), near that of another mesh if any is.

        Else the one from rest; raises what `from_rest` does.
        """
        near = self.near(tensions, known) if known and is_loaded(self.system.scene) else None
        return near or self.from_rest(tensions)

    def near(self, tensions: Array, known: Linearised) -> Linearised | None:
        """Return the equilibrium near that of another mesh; None if there is none."""
        return newton(self.system, tensions, 1.0, self.carried(tensions, known), NEAR)

    def from_rest(self, tensions: Array, looser: float = 1.0) -> Linearised:
        """Return the equilibrium that the unloaded arm comes to under tensions (n_tendons,).

        Without loads the states that loads would begin from are the equilibrium. The last steps of
        Newton's method may be so many times `looser` than elsewhere. Raises SnapError,
        which says where its branch ends or loses its stability, and UnsettledSectionError where a
        section has none, or tensions that leave a tendon no length keep loads from being applied in
        steps.
        """
        at, loaded = self.system, is_loaded(self.system.scene)
        point = Linearised(at, at.x(tensions, 1.0 - loaded, self.without_loads(tensions)))
        if not loaded:
            return point
        crushed = unloaded_sections(at).crushed(at.strains(point.states))
        steps = _SOON_IF_CRUSHED if crushed else np.inf
        end = follow_on(Followed(point, 0.0, ""), 1.0, LEAST_STEP, steps, looser)
        if end.load >= 1:
            return end.point
        if crushed:
            raise UnsettledSectionError(crushed.s)
        raise SnapError(end.load, end.why or SNAPS)

    def without_loads(self, tensions: Array) -> Array:
        """Return the states under tensions without loads; raises UnsettledSectionError."""
        return self.system.start(tensions, unloaded_sections(self.system).strains(tensions))

    def carried(self, tensions: Array, known: Linearised) -> Array:
        """Return the states of this mesh by the polynomials of another's strains.

        Where tensions differ, of the states at these by its derivatives.
        """
        before, states = known.system, known.states
        if not np.array_equal(tensions, known.tensions):
            states = states + known.by_tensions @ (tensions - known.tensions)
        if before.of is self.system.of and np.array_equal(before.mesh.s, self.mesh.s):
            return states
        strains = carried_strains(before, before.strains(states), self.system)
        return self.system.start(tensions, strains, 1.0)


def carried_strains(before: System, strains: Array, after: System) -> Array:
    """Return the strains (N stages, ...) at the stages of a mesh by those of another's stages."""
    mesh, m = before.mesh, before.of.form.stages
    step = np.clip(np.searchsorted(mesh.s, after.s) - 1, 0, mesh.steps - 1)
    x = (after.s - mesh.s[step]) / np.diff(mesh.s)[step]
    by_element = strains.reshape(mesh.steps, m, *strains.shape[1:])
    return np.asarray(np.einsum("nm,nm...->n...", gauss(m).at(x), by_element[step]))
