"""The forward map of a loaded scene on one mesh: tensions to states by collocation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model.arm import Arm
from model.equilibrium.continuation import by_load_steps, near
from model.equilibrium.equilibrium import Collocated
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import NEAR, newton_many
from model.errors import OctoplanError, SnapError, UnsettledSectionError
from model.loads import is_loaded
from model.paths import Array
from model.scene import Scene
from model.transcription.collocation import gauss
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
        self._unloaded: tuple[Array, Array] | None = None

    def equilibrium(self, tensions: Array, near: Linearised | None = None) -> Collocated:
        """Return what `found` does, as a value."""
        return Collocated(self.found(tensions, near), self.refinement)

    def found(self, tensions: Array, known: Linearised | None = None) -> Linearised:
        """Return the equilibrium under tensions, near one that another mesh has, if any does."""
        if not is_loaded(self.system.scene):
            x = self.system.x(tensions, 1.0, self.without_loads(tensions))
            return Linearised(self.system, x)
        here = None if known is None else self.near(tensions, known)
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
        that leave a tendon no length keep loads from being applied in steps.
        """
        starts = self._starts(tensions)
        found: list[Linearised | OctoplanError | None]
        found = [own if isinstance(own, OctoplanError) else None for own in starts]
        left = [i for i, own in enumerate(found) if own is None]
        states = np.full((len(tensions), self.system.of.n_states), np.nan)
        for i in left:
            states[i] = starts[i]
        crushed = {i: self._crushed(states[i]) for i in left}
        for some, most in (
            ([i for i in left if crushed[i] is None], steps),
            ([i for i in left if crushed[i] is not None], min(steps, _SOON_IF_CRUSHED)),
        ):
            ends = by_load_steps(self.system, tensions[some], states[some], most)
            for i, end in zip(some, ends, strict=True):
                place, refused = crushed[i], isinstance(end, SnapError)
                found[i] = UnsettledSectionError(place) if refused and place is not None else end
        return [own for own in found if own is not None]

    def _crushed(self, states: Array) -> float | None:
        """Return where unloaded states leave a tendon no length [m]; None if nowhere."""
        crushed = settled_sections(self.system).crushed(self.system.strains(states))
        return float(self.system.s[np.argmax(crushed)]) if crushed.any() else None

    def _starts(self, tensions: Array) -> list[Array | OctoplanError]:
        """Return the states without loads under each of tensions, or why there are none."""
        found: list[Array | OctoplanError] = []
        rows: Array | None = None
        if len(tensions) > 1:
            strains = settled_sections(self.system).of_many(tensions)
            rows = self.system.starts(tensions, strains)
        for i, row in enumerate(tensions):
            if rows is not None and np.isfinite(rows[i].sum()):
                found.append(rows[i])
                continue
            try:
                found.append(self.without_loads(row))
            except UnsettledSectionError as reason:
                found.append(reason)
        return found

    def without_loads(self, tensions: Array) -> Array:
        """Return the states under tensions without loads; raises UnsettledSectionError.

        The last ones are remembered.
        """
        at, last = self.system, self._unloaded
        if last is None or not np.array_equal(last[0], tensions):
            states = at.start(tensions, settled_sections(at).strains(tensions))
            last = self._unloaded = tensions.copy(), states
        return last[1].copy()

    def carried(self, tensions: Array, known: Linearised) -> Array:
        """Return the states of this mesh by the polynomials of another's strains."""
        return np.asarray(self._carried(tensions[None], known.system, known.states[None])[0])

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
