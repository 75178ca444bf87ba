"""From tensions to an optimum of the arm in contact: programs on what touches, one after another.

The arm is settled; the program is solved with what touches told, to the optimum on these contacts
and no farther than a box of tensions; the arm is led there, and what touches then is told the next
one. Places where it touches become nodes each time, so that the optimum is that of the arm itself
(an exchange method; Hettich and Kortanek, SIAM Review 35, 1993). The box shrinks where the arm
would snap or let go on the way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from model.contact.contacts import touches_of
from model.contact.forward import TouchingMap
from model.contact.stability import held_stability
from model.equilibrium.equilibrium import Collocated
from model.equilibrium.forward import STAGES
from model.equilibrium.linearised import Linearised
from model.errors import OctoplanError
from model.paths import Array
from model.time_limit import check_time
from planner.contact.grasp import Grasp
from planner.contact.load_path import LoadPath
from planner.contact.program import Optimality, Program
from planner.program.terms import stations_of
from planner.solve.task import Task
from planner.targets.hold import Hold

# Programs at most; steps of tensions, over what bends the arm by 1 rad, at first and at least, of
# one that is the last, and of one that is if it is no shorter than the one before by half; how much
# of the violation of targets a step has to make up for.
_ROUNDS, _FIRST, _LEAST, _STAYS, _NEARLY, _LESS = 25, 2.0, 1e-3, 1e-7, 1e-6, 0.9
# By how much better than what is asked the arm is to stand, as long as steps are long.
_CLOSE = 1 - 1e-6
# Gaps that are nearly closed, over the length: programs have nodes there, that tell them.
_NEAR = 1e-3


@dataclass(frozen=True, eq=False)
class Optimum:
    """Where programs and settled arms agree.

    Attributes
    ----------
    here : Linearised
        The equilibrium.
    steps : LoadPath
        Tensions by which the arm was led there, its own last.
    lacks : float
        What targets lack; 0 where they are met.
    optimality : Optimality
    least : float
        The stability that it was held to; 0 where it only stands.
    """

    here: Linearised
    steps: LoadPath
    lacks: float
    optimality: Optimality
    least: float

    @property
    def effort(self) -> float:
        """Root of the sum of squared tensions [N]."""
        return float(np.linalg.norm(self.here.tensions))

    @property
    def stability(self) -> float:
        """See model.contact.stability."""
        return held_stability(self.here)


class Exchange:
    """Programs and settled arms of a task on meshes of a refinement."""

    def __init__(self, task: Task, refinement: int) -> None:
        self.task, arm = task, task.arm
        mesh = (STAGES, refinement, stations_of(arm, task.targets))
        self.map = TouchingMap(arm, task.scene, *mesh, task.machine_code)

    def settled(self, tensions: Array, near: Linearised | None = None) -> Linearised:
        """Return the equilibrium from rest, or next to another; raises what settling does."""
        if near is None:
            return self.map.led(tensions, tensions, None).settled.here
        known = Collocated(near, self.map.refinement)
        return self.map.led(tensions, near.tensions, known, jumps=False).settled.here

    def along(self, load_path: LoadPath) -> Linearised:
        """Return the equilibrium at the end of a load path; raises what settling does."""
        *_, here = self._way(load_path)
        return here

    def _way(self, load_path: LoadPath) -> Iterator[Linearised]:
        here = None
        for T in load_path:
            check_time()
            here = self.settled(np.array(T), here)
            yield here

    def optimum(self, here: Linearised, least: float = 0.0) -> Optimum | None:
        """Return the optimum that programs lead to from an equilibrium; None if they lead nowhere.

        With a stability of at least so much. Where targets cannot be met from there that which
        lacks least.
        """
        box, steps, lacked, last = _FIRST, [here.tensions], np.inf, None
        before = np.inf
        for _ in range(_ROUNDS):
            check_time()
            here = self.map.with_nodes(here, _NEAR)
            program = self._program(here, least)
            z = self.unknowns(program, here)
            point = program.solve(z, box=box, near=last)
            if not point.met:
                point = program.solve(z, slacks=True, box=box)
            lacks = program.lacking(point.z)
            step = program.tensions(point.z) - here.tensions
            size = float(np.abs(step).max()) / program.force
            stays = size < _STAYS or (size < _NEARLY and size > before / 2)
            stays |= bool(lacks and lacks > _LESS * lacked and size < _LEAST)
            if point.met and stays:
                z[program.tangential] = point.z[program.tangential]
                path = tuple(tuple(T.tolist()) for T in steps)
                return Optimum(here, path, lacks, program.optimality(z), least)
            there = self._led(here, step) if point.met else None
            if there is None:
                box = min(box, size) / 4
                if box < _LEAST:
                    return None
                continue
            here, lacked, last, before = there, lacks, point, size
            steps.append(here.tensions)
        return None

    def optimality(self, here: Linearised, least: float) -> Optimality:
        """Return how far an equilibrium is from an optimum."""
        here = self.map.with_nodes(here, _NEAR)
        program = self._program(here, least)
        return program.optimality(self.unknowns(program, here))

    def _led(self, here: Linearised, step: Array) -> Linearised | None:
        """Return the equilibrium a step of tensions further; None where the arm snaps."""
        try:
            return self.settled(here.tensions + step, here)
        except OctoplanError:
            return None

    def _program(self, here: Linearised, least: float = 0.0) -> Program:
        task = self.task
        return Program(here.system, task.targets, task.allowed, least, sharp=True)

    def unknowns(self, program: Program, here: Linearised) -> Array:
        """Return the program's unknowns at an equilibrium, tangential forces the best ones."""
        z = program.guess(here.tensions, here.states)
        places = program.structure.tangential
        for i, hold in enumerate(own for own in self.task.targets if isinstance(own, Hold)):
            touches = touches_of(here)
            nodes = [here.system.mesh.node(t.s) for t in touches if t.obstacle == hold.obstacle]
            own = places[i, np.array(nodes, dtype=int) - 1]
            z[own] = Grasp.of(self.task.arm, touches, hold).best() / program.z_unit[own]
        return z

    def lacking(self, here: Linearised) -> float:
        """Return what is left of the wrenches of holds, over their sizes."""
        found = 0.0
        for hold in (own for own in self.task.targets if isinstance(own, Hold)):
            grasp = Grasp.of(self.task.arm, touches_of(here), hold)
            left = grasp.scaled(grasp.left(grasp.best()))
            found += float(np.linalg.norm(left)) / hold.size(self.task.arm)
        return found

    def stands(self, own: Optimum) -> bool:
        """Return whether an optimum stands as well as is asked."""
        return own.stability >= max(self.task.statement.margin * _CLOSE, 0.0)
