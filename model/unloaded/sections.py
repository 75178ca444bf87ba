"""The strains of cross-sections under tensions alone, in numbers: one solver for any tension.

Without loads the wrench of body and tendons vanishes at each cross-section by itself. The paper's
balance is linear in its strains; with an energy steps of model.unloaded.statics are taken by
all cross-sections that are not in equilibrium yet: four to seven for ordinary tensions, thirty for
a thousand times as much.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from model.arm import Arm
from model.cross_section import cross_section_of
from model.cross_section.law import CrossSection, reported, strains_of
from model.cross_section.sections import Sections
from model.effects import ExactTendons, Extension, NeoHookean
from model.errors import CollapsedError, UnsettledSectionError
from model.machine.buffered import Mapped
from model.mesh import Mesh
from model.paths import Array
from model.scene import Scene
from model.stations import Counts, stations
from model.transcription.system import System
from model.unloaded.statics import ClosedStatics, EnergyStatics, balance_function, closed_statics

# Exact tendons keep a crushed section from turning inside out: what is left of its length then is
# the width that keeps their roots smooth (see model.cross_section.law), and no shape.
LEAST_STRETCH = 1e-7
# Steps at most; of so many sections those in equilibrium are left out of further ones.
_STEPS, _MANY = 40, 256
_ALL = slice(None)


def unloaded(scene: Scene) -> Scene:
    """Return the scene with what a section settles by itself, and nothing else."""
    kept = (Extension, ExactTendons, NeoHookean)
    return Scene(*(effect for effect in scene.effects if isinstance(effect, kept)))


class SectionSolver:
    """Pull (N, n_pull) and data (N, n_data) of cross-sections -> strains (N, n), NaN for none.

    Data may have fewer rows, which are taken again and again.
    """

    def __init__(self, statics: ClosedStatics, machine_code: bool) -> None:
        self._tolerance, self._step = 0.0, None
        if isinstance(statics, EnergyStatics):
            self._tolerance, begin = statics.settled, statics.begun()
            self._step = Mapped(statics.step(), machine_code)
        else:
            begin = balance_function(statics)
        self._begin = Mapped(begin, machine_code)

    def __call__(self, pull: Array, data: Array) -> Array:
        """See the class."""
        if self._step is None:
            return self._begin(pull, data)[0]
        u, w = self._begin(pull, data)
        strains, left = np.full(u.shape, np.nan), np.arange(len(u))
        for _ in range(_STEPS):
            u, w, size, v = self._step(u, w, pull, data)
            done = size[:, 0] < self._tolerance
            strains[left[done]] = v[done]
            going = size[:, 0] >= self._tolerance  # what is no number stays so
            if not going.any():
                break
            if len(left) > _MANY and not going.all():
                data = data[np.flatnonzero(going) % len(data)]
                left = left[going]
                u, w, pull = (part[going] for part in (u, w, pull))
        return strains


@lru_cache(maxsize=32)
def section_solver(statics: ClosedStatics, machine_code: bool = False) -> SectionSolver:
    """Return what solves cross-sections of a kind, made once."""
    return SectionSolver(statics, machine_code)


class StrainsByTensions:
    """The strains of K cross-sections, in the law of their statics, by tensions.

    Attributes
    ----------
    maps, data
        Maps (K, n_pull, n_tendons) from tensions to pull, and data (K, n_data); see the statics.
    """

    def __init__(
        self, statics: ClosedStatics, maps: Array, data: Array, machine_code: bool
    ) -> None:
        self.statics, self.maps, self.data = statics, maps, data
        self._flat = maps.reshape(-1, maps.shape[2])
        self._solver = section_solver(statics, machine_code)

    @classmethod
    def at(
        cls, arm: Arm, statics: ClosedStatics, s: Array, active: Counts, machine_code: bool = False
    ) -> StrainsByTensions:
        """Return those at s (K,), which `active` (K,) anchorages' tendons cross."""
        at = stations(arm, s, active)
        return cls(statics, statics.pulls(arm, at), statics.data(at).T, machine_code)

    def __call__(self, tensions: Array) -> Array:
        """Return the strains (K, n) under tensions (n_tendons,); NaN where none balance."""
        return self._solver((self._flat @ tensions).reshape(self.maps.shape[:2]), self.data)

    def of_many(self, tensions: Array, places: slice = _ALL) -> Array:
        """Return the strains (M, k, n) under tensions (M, n_tendons) at some of the places."""
        maps, M = self.maps[places], len(tensions)
        K, n_pull, n = maps.shape
        pull = (tensions @ maps.reshape(-1, n).T).reshape(M * K, n_pull)
        return self._solver(pull, self.data[places]).reshape(M, K, -1)


class UnloadedSections:
    """The cross-sections of an arm at s (N,) that `active` (N,) anchorages' tendons cross.

    Strains are those of a law, which may twist and shear sections: these do not.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        law: CrossSection,
        s: Array,
        active: Counts,
        machine_code: bool = False,
    ) -> None:
        self.sections = Sections(arm, scene, law, s, active, machine_code)
        self._exact, statics = scene.has(ExactTendons), closed_statics(unloaded(scene), arm)
        self._settled = StrainsByTensions.at(arm, statics, s, active, machine_code)

    def strains(self, tensions: Array) -> Array:
        """Return the strains (N, n) under tensions (n_tendons,); raises UnsettledSectionError."""
        v, law, plain = self._settled(tensions), self.sections.law, self._settled.statics.law
        lost = np.isnan(v).any(axis=1)
        if lost.any():
            raise UnsettledSectionError(float(self.sections.s[np.argmax(lost)]))
        return v if law == plain else strains_of(law, reported(plain, v))

    def crushed(self, strains: Array) -> CollapsedError | None:
        """Return what to tell of the first section where strains (N, n) leave a tendon no length.

        None where they do so nowhere.
        """
        at = self.sections
        short = at.place[at.speeds(strains) <= LEAST_STRETCH]
        if not self._exact or not short.size:
            return None
        i = int(short.min())
        stretch = 1 + reported(at.law, strains[i : i + 1])[0, 3]
        return CollapsedError(float(at.s[i]), float(stretch))


@lru_cache(maxsize=32)
def unloaded_sections(at: System) -> UnloadedSections:
    """Return the cross-sections at the stages of a system."""
    active, form = np.repeat(at.mesh.active, at.of.form.stages), at.of.form
    return UnloadedSections(at.arm, at.scene, form.law, at.s, active, form.machine_code)


def folded(arm: Arm, scene: Scene, mesh: Mesh, tensions: Array) -> float | None:
    """Return where from the base [m] tensions (n_tendons,) [N] first leave a tendon no length.

    None where they do so nowhere, at both ends of each step of a mesh. Beyond, the body would be
    folded into itself. Only exact tendons without loads come to that: with loads such tensions are
    refused.
    """
    law = cross_section_of(scene, arm.is_curved)
    ends = np.column_stack([mesh.s[:-1], mesh.s[1:]]).ravel()
    at = UnloadedSections(arm, scene, law, ends, np.repeat(mesh.active, 2))
    crushed = at.crushed(at.strains(tensions))
    return crushed.s if crushed else None
