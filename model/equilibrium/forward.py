"""The forward map of a loaded scene on one mesh: tensions to states by collocation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from model.arm import Arm
from model.equilibrium.equilibrium import Collocated, Equilibrium
from model.equilibrium.linearised import Linearised, linearised
from model.equilibrium.newton import (
    LEAST_STEP,
    NEAR,
    SNAPS,
    Followed,
    follow_on_many,
    newton,
    newton_many,
)
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
        return Collocated(self.found(tensions, known), self.refinement)

    def found(self, tensions: Array, known: Linearised | None = None) -> Linearised:
        """Return the equilibrium under tensions (n_tendons,), near that of another mesh if any is.

        Else the one from rest. Raises what `many` returns in place of one.
        """
        (end,) = self.many(tensions[None], [known])
        if isinstance(end, OctoplanError):
            raise end
        return end

    def near(self, tensions: Array, known: Linearised) -> Linearised | None:
        """Return the equilibrium near that of another mesh; None if there is none."""
        return newton(self.system, tensions, 1.0, self.carried(tensions, known), NEAR)

    def many(
        self, tensions: Array, known: Sequence[Linearised | None]
    ) -> list[Linearised | OctoplanError]:
        """Return the equilibria under tensions (N, n_tendons), each near one of another mesh.

        From rest where there is none, or why not: see from_rest_many.
        """
        ends: list[Linearised | OctoplanError | None] = [None] * len(tensions)
        loaded = is_loaded(self.system.scene)
        warm = [(i, here) for i, here in enumerate(known) if here is not None and loaded]
        for before in dict.fromkeys(here.system for _, here in warm):
            some = [i for i, here in warm if here.system is before]
            T = tensions[some]
            guesses = self._carried(T, [here for _, here in warm if here.system is before])
            for i, here in zip(some, newton_many(self.system, T, 1.0, guesses, NEAR), strict=True):
                ends[i] = here
        cold = [i for i, end in enumerate(ends) if end is None]
        if cold:
            for i, end in zip(cold, self.from_rest_many(tensions[cold]), strict=True):
                ends[i] = end
        return [end for end in ends if end is not None]

    def from_rest_many(self, tensions: Array) -> list[Linearised | OctoplanError]:
        """Return the equilibria that the unloaded arm comes to under tensions (N, n_tendons).

        In place of one a SnapError that says where its branch ends or loses its stability, and an
        UnsettledSectionError where tensions that leave a tendon no length keep loads from being
        applied in steps. Without loads the states that loads would begin from are the equilibrium.
        """
        at, sections = self.system, unloaded_sections(self.system)
        strains = sections.of_many(tensions)
        ends: list[Linearised | OctoplanError] = []
        going, steps, crushed = list[int](), list[float](), list[bool]()
        for i, v in enumerate(strains):
            lost = np.isnan(v).any(axis=1)
            refused = lost | sections.crushed(v)
            ends.append(UnsettledSectionError(float(at.s[np.argmax(refused)])))
            if not lost.any():
                going.append(i)
                crushed.append(bool(refused.any()))
                steps.append(_SOON_IF_CRUSHED if crushed[-1] else np.inf)
        states = at.starts(tensions[going], strains[going])
        loaded = is_loaded(at.scene)
        x = [at.x(tensions[i], 1.0 - loaded, y) for i, y in zip(going, states, strict=True)]
        starts = linearised(at, np.array(x)) if loaded and x else [Linearised(at, y) for y in x]
        if not loaded:
            for i, here in zip(going, starts, strict=True):
                ends[i] = here
            return ends
        branches = [Followed(here, 0.0, "") for here in starts]
        followed = follow_on_many(branches, 1.0, LEAST_STEP, np.array(steps))
        for i, end, folds in zip(going, followed, crushed, strict=True):
            if end.load >= 1:
                ends[i] = end.here
            elif not folds:
                ends[i] = SnapError(end.load, end.why or SNAPS)
        return ends

    def without_loads(self, tensions: Array) -> Array:
        """Return the states under tensions without loads; raises UnsettledSectionError."""
        return self.system.start(tensions, unloaded_sections(self.system).strains(tensions))

    def carried(self, tensions: Array, known: Linearised) -> Array:
        """Return the states of this mesh by the polynomials of another's strains.

        Where tensions differ, of the states at these by its derivatives.
        """
        return np.asarray(self._carried(tensions[None], [known])[0])

    def _carried(self, tensions: Array, known: Sequence[Linearised]) -> Array:
        """Return `carried` of tensions (N, n_tendons) and N equilibria of one other mesh."""
        before, states = known[0].system, np.array([here.states for here in known])
        for y, here, T in zip(states, known, tensions, strict=True):
            if not np.array_equal(T, here.tensions):
                y += here.by_tensions @ (T - here.tensions)
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
