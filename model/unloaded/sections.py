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
from model.machine.compiled import built
from model.mesh import Mesh
from model.paths import Array
from model.scene import Scene
from model.stations import Counts, stations
from model.transcription.system import System
from model.unloaded.statics import ClosedStatics, PaperStatics, closed_statics

# Exact tendons keep a crushed section from turning inside out: what is left of its length then is
# the width that keeps their roots smooth (see model.cross_section.law), and no shape.
LEAST_STRETCH = 1e-7
# Steps at most; of so many sections those in equilibrium are left out of further ones.
_STEPS, _MANY = 40, 256


def unloaded(scene: Scene) -> Scene:
    """Return the scene with what a section settles by itself, and nothing else."""
    kept = (Extension, ExactTendons, NeoHookean)
    return Scene(*(effect for effect in scene.effects if isinstance(effect, kept)))


def _kernels(statics: ClosedStatics, machine_code: bool) -> list[Mapped]:
    """Return (pull, data) -> strains; or what steps to these begin with, and such a step."""
    return [Mapped(each, machine_code) for each in statics.functions()]


class StrainsByTensions:
    """The strains of K cross-sections, in the law of their statics, by tensions.

    Attributes
    ----------
    maps, data
        Maps (K, n_pull, n_tendons) from tensions to pull, and data (K, n_data); see the statics.
    """

    def __init__(
        self, statics: ClosedStatics, maps: Array, data: Array, machine_code: bool = False
    ) -> None:
        self.statics, self.maps, self.data = statics, maps, data
        self._flat, self._machine_code = maps.reshape(-1, maps.shape[2]), machine_code

    @classmethod
    def at(
        cls, arm: Arm, statics: ClosedStatics, s: Array, active: Counts, machine_code: bool = False
    ) -> StrainsByTensions:
        """Return those of the cross-sections at s (K,), of the tendons of `active` anchorages."""
        at = stations(arm, s, active)
        return cls(statics, statics.pulls(arm, at), statics.data(arm.material, at), machine_code)

    def __call__(self, tensions: Array) -> Array:
        """Return the strains (K, n) under tensions (n_tendons,); NaN where none balance."""
        return self._solve((self._flat @ tensions).reshape(self.maps.shape[:2]), self.data)

    def known(self, tensions: Array) -> tuple[Array, ...]:
        """Return flat what strains are an expression of: pull and data, or strains themselves."""
        if self.statics.is_explicit:
            return self._flat @ tensions, self.data.ravel()
        return (self(tensions).ravel(),)

    def columns(self, tensions: Array, count: int, some: int) -> list[Array]:
        """Return the same at the first places for tensions (M, n_tendons), by columns.

        Of `count` places strains are solved for at `some` at a time.
        """
        if self.statics.is_explicit:
            flat = self.maps[:count].reshape(-1, tensions.shape[1])
            return [flat @ tensions.T, self.data[:count].reshape(-1, 1)]
        parts = [slice(k, k + some) for k in range(0, count, some)]
        values = [self.of_many(tensions, part).reshape(len(tensions), -1).T for part in parts]
        return [np.concatenate(values)]

    def of_many(self, tensions: Array, places: slice) -> Array:
        """Return the strains (M, k, n) under tensions (M, n_tendons) at some of the places."""
        maps, M = self.maps[places], len(tensions)
        K, n_pull, n = maps.shape
        pull = (tensions @ maps.reshape(-1, n).T).reshape(M * K, n_pull)
        return self._solve(pull, self.data[places]).reshape(M, K, -1)

    def _solve(self, pull: Array, data: Array) -> Array:
        """Return the strains (N, n) under pull (N, n_pull), NaN for none.

        Data may have fewer rows, which are taken again and again.
        """
        begin, *step = built(_kernels, self.statics, self._machine_code)
        u, *w = begin(pull, data)
        if isinstance(self.statics, PaperStatics):
            return u
        strains, left = np.full(u.shape, np.nan), np.arange(len(u))
        for _ in range(_STEPS):
            u, *w, size, v = step[0](u, *w, pull, data)
            done = size[:, 0] < self.statics.settled
            strains[left[done]] = v[done]
            going = size[:, 0] >= self.statics.settled  # what is no number stays so
            if not going.any():
                break
            if len(left) > _MANY and not going.all():
                data = data[np.flatnonzero(going) % len(data)]
                left = left[going]
                u, *w, pull = (part[going] for part in (u, *w, pull))
        return strains


class UnloadedSections(Sections):
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
        super().__init__(arm, scene, law, s, active, machine_code)
        self._exact, statics = scene.has(ExactTendons), closed_statics(unloaded(scene), arm)
        self._settled = StrainsByTensions.at(arm, statics, s, active, machine_code)

    def strains(self, tensions: Array) -> Array:
        """Return the strains (N, n) under tensions (n_tendons,); raises UnsettledSectionError."""
        v, plain = self._settled(tensions), self._settled.statics.law
        lost = np.isnan(v).any(axis=1)
        if lost.any():
            raise UnsettledSectionError(float(self.s[np.argmax(lost)]))
        return v if self.law == plain else strains_of(self.law, reported(plain, v))

    def crushed(self, strains: Array) -> CollapsedError | None:
        """Return what to tell of the first section where strains (N, n) leave a tendon no length.

        None where they do so nowhere.
        """
        short = self.place[self.speeds(strains)[:, 0] <= LEAST_STRETCH]
        if not self._exact or not short.size:
            return None
        i = int(short.min())
        stretch = 1 + reported(self.law, strains[i : i + 1])[0, 3]
        return CollapsedError(float(self.s[i]), float(stretch))


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
