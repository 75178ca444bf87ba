"""Meshes of an arm whose numbers change: the nodes of one move along, so that all stays smooth."""

from __future__ import annotations

import numpy as np

from model import Arm, InputError, Scene
from model.equilibrium.forward import STAGES
from model.mesh import Mesh
from model.paths import Array
from model.transcription.neighbours import keep_sign, landmarks, moved_mesh
from model.transcription.system import System, system


class Meshes:
    """The equations of arms that differ by numbers, on meshes of a refinement.

    With `machine_code` their kernels are compiled; elements have so many `stages`.
    """

    def __init__(self, refinement: int, machine_code: bool = False, stages: int = STAGES) -> None:
        self.refinement, self.machine_code, self.stages = refinement, machine_code, stages
        self._first: tuple[Mesh, Array, Array] | None = None

    def system(self, arm: Arm, scene: Scene, at: tuple[float, ...]) -> System:
        """Return the equations of an arm, with arc lengths `at` as nodes [m].

        On the first mesh as it fits this arm; where places have passed each other, on a new one.
        The base's quaternion keeps its sign.
        """
        marks = landmarks(arm, scene, at)
        if self._first is not None:
            mesh, old, base = self._first
            try:
                found = System(
                    arm,
                    scene,
                    moved_mesh(mesh, old, marks),
                    self.stages,
                    machine_code=self.machine_code,
                )
            except InputError:
                pass
            else:
                keep_sign(found.base, base)
                return found
        places = tuple(np.unique(at).tolist())
        form = (self.stages, self.refinement, places, True, self.machine_code)
        found = system(arm, scene, *form)
        self._first = found.mesh, marks, found.base
        return found
