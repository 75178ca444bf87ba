"""What targets ask of the settled arm, contact included, and how that moves with the tensions.

By the implicit function theorem through the equations of equilibrium, what touches held shut. Where
contact comes or goes the derivatives jump; the values do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from model.arm import Arm
from model.contact.forward import KnownContact, TouchingMap
from model.contact.touches import Touches
from model.equilibrium.forward import STAGES
from model.equilibrium.linearised import Linearised
from model.paths import Array
from model.scene import Scene
from model.transcription.layout import POSE
from planner.program.terms import KINDS, stations_of, terms_function
from planner.targets.base import Target


@dataclass(frozen=True, eq=False)
class SettledTerms:
    """The terms of targets at tensions.

    Attributes
    ----------
    here : Linearised
        The equilibrium.
    snaps : tuple of float
        The shares of the way at which the arm jumped.
    values, slopes : by kind
        Terms (n,), and their derivatives by the tensions (n, n_tendons).
    """

    here: Linearised
    snaps: tuple[float, ...]
    values: dict[str, Array]
    slopes: dict[str, Array]

    @property
    def tensions(self) -> Array:
        """[N] (n_tendons,)."""
        return self.here.tensions


@dataclass(frozen=True, eq=False)
class Settling:
    """Settles an arm on meshes of a refinement, and evaluates targets.

    Attributes
    ----------
    arm, scene, targets
        What is asked.
    refinement : int
    machine_code : bool
    """

    arm: Arm
    scene: Scene
    targets: tuple[Target, ...]
    refinement: int
    machine_code: bool = False

    @cached_property
    def _forward(self) -> TouchingMap:
        stations = stations_of(self.arm, self.targets)
        mesh = (STAGES, self.refinement, stations)
        return TouchingMap(self.arm, self.scene, *mesh, self.machine_code)

    @cached_property
    def _terms(self) -> tuple[ca.Function, ca.Function]:
        """(poses, numbers -> terms by kind), and their derivatives by the poses."""
        terms = terms_function(self.arm, self.targets)
        poses = ca.MX.sym("poses", *terms.size_in(0))
        numbers = ca.MX.sym("numbers", *terms.size_in(1))
        found = terms(poses, numbers, ca.MX(0, 1))
        slopes = [ca.densify(ca.jacobian(value, poses)) for value in found]
        given, values = [poses, numbers], list(found)
        return ca.Function("terms", given, values), ca.Function("slopes", given, slopes)

    def at(self, tensions: Array, near: SettledTerms | None = None) -> SettledTerms:
        """Return the terms where the arm comes to, from rest or from another equilibrium.

        Raises SnapError where it comes to none, and near another where it would jump.
        """
        known, before = None, tensions
        if near is not None:
            system = near.here.system
            known = KnownContact(system, near.here.states, Touches.of(system))
            before = near.tensions
        here, snaps = self._forward.come_to(tensions, before, known, known is None)
        mesh, of = here.system.mesh, here.system.of
        nodes = [mesh.node(s) for s in stations_of(self.arm, self.targets)]
        places = of.nodes[nodes, :POSE]
        poses = here.states[places]
        numbers = np.concatenate([target.parameters(self.arm) for target in self.targets])
        moved = here.by_tensions[places.ravel()]
        values, slopes = (function(poses.T, numbers) for function in self._terms)
        found = {kind: np.array(v).ravel() for kind, v in zip(KINDS, values, strict=True)}
        rates = {
            kind: np.array(J).reshape(-1, places.size) @ moved
            for kind, J in zip(KINDS, slopes, strict=True)
        }
        return SettledTerms(here, snaps, found, rates)
