"""The forward map of a loaded scene on one mesh: tensions to states by collocation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model.arm import Arm
from model.equilibrium.equilibrium import Collocated, Equilibrium
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import NEAR, by_load_steps, near, newton_many
from model.errors import OctoplanError, SnapError, UnsettledSectionError
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
        found = cls.__new__(cls)
        found.refinement = 0
        found._state(stated)
        return found

    def _state(self, stated: System) -> None:
        self.system, self.mesh = stated, stated.mesh
        self.machine_code = stated.of.form.machine_code

    def equilibrium(self, tensions: Array, near: Equilibrium | None = None) -> Collocated:
        """Return the equilibrium under tensions, near that of another mesh if given."""
        known = None if near is None else near.states
        return Collocated(self.found(tensions, known), self.refinement)

    def found(self, tensions: Array, known: Linearised | None = None) -> Linearised:
        """Return the equilibrium under tensions, near one that another mesh has, if any does."""
        loaded = is_loaded(self.system.scene)
        here = self.near(tensions, known) if loaded and known is not None else None
        return here or self.from_rest(tensions)

    def many(
        self, tensions: Array, known: Sequence[Linearised | None]
    ) -> list[Linearised | OctoplanError]:
        """Return the equilibria under tensions (N, n_tendons), each near what is known of it.

        Or why there is none, as from_rest_many.
        """
        found: list[Linearised | OctoplanError | None] = [None] * len(tensions)
        for before in dict.fromkeys(own.system for own in known if own is not None):
            some = [i for i, own in enumerate(known) if own is not None and own.system is before]
            states = np.array([own.states for own in known if own and own.system is before])
            guesses = self._carried(tensions[some], before, states)
            given = self.system, tensions[some], 1.0, guesses, NEAR
            for i, here in zip(some, newton_many(*given).solutions, strict=True):
                found[i] = here
        left = [i for i, here in enumerate(found) if here is None]
        for i, end in zip(left, self.from_rest_many(tensions[left]), strict=True):
            found[i] = end
        return [own for own in found if own is not None]

    def near(self, tensions: Array, known: Linearised) -> Linearised | None:
        """Return the equilibrium near one that another mesh has; None if there is none."""
        return near(self.system, tensions, self.carried(tensions, known))

    def from_rest(self, tensions: Array, steps: float = np.inf) -> Linearised:
        """Return the equilibrium that the unloaded arm comes to; see from_rest_many.

        Raises what that returns in place of one.
        """
        (found,) = self.from_rest_many(tensions[None], steps)
        if isinstance(found, OctoplanError):
            raise found
        return found

    def from_rest_many(
        self, tensions: Array, steps: float = np.inf
    ) -> list[Linearised | OctoplanError]:
        """Return the equilibria that the unloaded arm comes to under tensions (N, n_tendons).

        In place of one a SnapError as of by_load_steps, and an UnsettledSectionError where tensions
        that leave a tendon no length keep loads from being applied in steps. Without loads the
        states that loads would begin from are the equilibrium.
        """
        at, sections = self.system, unloaded_sections(self.system)
        strains = sections.of_many(tensions)
        found: list[Linearised | OctoplanError] = []
        going, limits, places = list[int](), list[float](), list[float | None]()
        for i, v in enumerate(strains):
            lost, crushed = np.isnan(v).any(axis=1), sections.crushed(v)
            refused = lost | crushed
            places.append(float(at.s[np.argmax(refused)]) if refused.any() else None)
            found.append(UnsettledSectionError(places[-1] or 0.0))
            if not lost.any():
                going.append(i)
                limits.append(min(steps, _SOON_IF_CRUSHED) if crushed.any() else steps)
        states = at.starts(tensions[going], strains[going])
        if not is_loaded(at.scene):
            for i, own in zip(going, states, strict=True):
                found[i] = Linearised(at, at.x(tensions[i], 1.0, own))
            return found
        ends = by_load_steps(at, tensions[going], states, np.array(limits))
        for i, end in zip(going, ends, strict=True):
            if places[i] is None or not isinstance(end, SnapError):
                found[i] = end
        return found

    def without_loads(self, tensions: Array) -> Array:
        """Return the states under tensions without loads; raises UnsettledSectionError."""
        return self.system.start(tensions, unloaded_sections(self.system).strains(tensions))

    def carried(self, tensions: Array, known: Linearised) -> Array:
        """Return the states of this mesh by the polynomials of another's strains.

        Where tensions differ, of those that it moves to by its derivatives.
        """
        change, states = tensions - known.tensions, known.states
        if change.any():
            states = states + known.by_tensions @ change
        return np.asarray(self._carried(tensions[None], known.system, states[None])[0])

    def _carried(self, tensions: Array, before: System, states: Array) -> Array:
        if before.of is self.system.of and np.array_equal(before.mesh.s, self.mesh.s):
            return states
        strains = np.moveaxis(states[:, before.of.stages], 0, -1)
        strains = np.moveaxis(carried_strains(before, strains, self.system), -1, 0)
        return self.system.starts(tensions, strains, 1.0)


def carried_strains(before: System, strains: Array, after: System) -> Array:
    """Return the strains (N stages, ...) at the stages of a mesh by those of another's stages."""
    mesh, m = before.mesh, before.of.form.stages
    step = np.clip(np.searchsorted(mesh.s, after.s) - 1, 0, mesh.steps - 1)
    x = (after.s - mesh.s[step]) / np.diff(mesh.s)[step]
    by_element = strains.reshape(mesh.steps, m, *strains.shape[1:])
    return np.asarray(np.einsum("nm,nm...->n...", gauss(m).at(x), by_element[step]))
