"""Tasks of an arm whose numbers are unknown: how far each is from met, with derivatives.

Every task has tensions of its own; what the arm misses of its targets is differentiated by them and
by the unknowns, both through the equilibrium of its shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from model import Arm
from model.equilibrium.by_numbers import ByNumbers
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import newton
from model.paths import Array
from model.transcription.layout import POSE
from model.transcription.neighbours import number_derivatives
from model.transcription.system import System
from planner.program.terms import stations_of, terms_function
from planner.targets.base import Target
from planner.unknowns.meshes import Meshes
from planner.unknowns.parameters import Parameters
from planner.unknowns.pulled import FARTHEST, Pulled

Targets = tuple[Target, ...]


@dataclass(frozen=True, eq=False)
class Missed:
    """What a task misses at given numbers and tensions.

    Attributes
    ----------
    equality : (m,)
        Residuals that have to be 0; lengths over L, angles in rad.
    inequality : (k,)
        Quantities that have to be 0 or above.
    by_tensions : (m + k, n_tendons)
        Derivatives of both [1/N].
    by_numbers : (m + k, K)
        Derivatives by the unknowns.
    """

    equality: Array
    inequality: Array
    by_tensions: Array
    by_numbers: Array


class _Known(NamedTuple):
    """A shape that was found, and for what."""

    values: Array
    tensions: Array
    by: ByNumbers


class Tasks:
    """Tasks, and the shapes in which they were last looked at."""

    def __init__(self, parameters: Parameters, tasks: Sequence[Targets], refinement: int) -> None:
        self.parameters, self.tasks = parameters, tuple(tasks)
        self._meshes = Meshes(refinement)
        self._known: dict[int, _Known] = {}

    def missed(self, values: Array, tensions: Array) -> list[Missed]:
        """Return what each task misses at values (K,) and tensions (n_tasks, n_tendons).

        Raises InputError where there is no such arm, and what `settle` raises.
        """
        arm, scene = self.parameters.built(values, "")
        at = self._stations(arm)
        system = self._meshes.system(arm, scene, at)
        stencils = [
            [replace(near, at=self._stations(near.arm)) for near in stencil]
            for stencil in self.parameters.stencils(values, "")
        ]
        jacobian = number_derivatives(system, stencils, at)
        rest, found = Pulled(system), []
        for i, (targets, T) in enumerate(zip(self.tasks, tensions, strict=True)):
            here = self._near(i, system, values, T) or rest.at(T)
            here = Linearised(system, here.x)
            by = ByNumbers(here, jacobian, np.zeros((arm.n_tendons, values.size)))
            self._known[i] = _Known(values, T, by)
            found.append(_missed(arm, targets, by))
        return found

    def shape(self, i: int) -> ByNumbers:
        """Return the shape of a task where it was looked at last, with its derivatives."""
        return self._known[i].by

    def _stations(self, arm: Arm) -> tuple[float, ...]:
        return tuple(s for targets in self.tasks for s in stations_of(arm, targets))

    def _near(self, i: int, system: System, values: Array, tensions: Array) -> Linearised | None:
        """Return the shape near the last one of a task, None where there is none."""
        known = self._known.get(i)
        if known is None or known.by.here.system.of is not system.of:
            return None
        here = known.by.here
        guess = here.states + known.by.states @ (values - known.values)
        guess = guess + here.by_tensions @ (tensions - known.tensions)
        return newton(system, tensions, 1.0, guess, FARTHEST)


def _missed(arm: Arm, targets: Targets, by: ByNumbers) -> Missed:
    here = by.here
    if not targets:
        nothing = np.zeros((0, arm.n_tendons)), np.zeros((0, by.jacobian.p.shape[1]))
        return Missed(np.zeros(0), np.zeros(0), *nothing)
    mesh = here.system.mesh
    nodes = [mesh.node(s) for s in stations_of(arm, targets)]
    places = here.system.of.nodes[nodes, :POSE].ravel()
    numbers = np.concatenate([target.parameters(arm) for target in targets])
    poses = here.states[places].reshape(-1, POSE).T
    equality, inequality, jacobian = (np.array(v) for v in _terms(arm, targets)(poses, numbers))
    return Missed(
        equality.ravel(),
        inequality.ravel(),
        jacobian @ here.by_tensions[places],
        jacobian @ by.states[places],
    )


@lru_cache(maxsize=256)
def _terms(arm: Arm, targets: Targets) -> ca.Function:
    """Return poses (7, K), numbers -> equality, inequality, and their derivatives by the poses."""
    terms = terms_function(arm, targets)
    poses, numbers = ca.MX.sym("poses", *terms.size_in(0)), ca.MX.sym("p", terms.size1_in(1))
    equality, _, inequality, _ = terms(poses, numbers, ca.DM(0, 1))
    jacobian = ca.jacobian(ca.vertcat(equality, inequality), ca.vec(poses))
    return ca.Function("missed", [poses, numbers], [equality, inequality, ca.densify(jacobian)])
