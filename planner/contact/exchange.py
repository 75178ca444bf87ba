"""From tensions to an optimum of the arm in contact: programs on what touches, one after another.

The arm is settled; the program is solved with what touches set, to the optimum on these contacts
and no farther than a box of tensions; the arm is led there, and what touches then is set in the
next. Places where it touches become nodes each time, so that the optimum is that of the arm itself
(an exchange method; Hettich and Kortanek, SIAM Review 35, 1993). The box shrinks where the arm
would snap or let go on the way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.contact.contacts import touches_of
from model.contact.forward import TouchingMap
from model.contact.stability import held_stability
from model.contact.touches import Touches, forces
from model.equilibrium.equilibrium import Collocated, check_stretch
from model.equilibrium.forward import STAGES
from model.equilibrium.linearised import Linearised
from model.errors import OctoplanError
from model.paths import Array
from model.time_limit import check_time
from planner.contact.grasp import Grasp
from planner.contact.load_path import LoadPath
from planner.contact.program import Optimality, Program
from planner.program.limits import natural_tensions
from planner.program.terms import stations_of
from planner.solve.task import Task
from planner.targets.hold import Hold

# Programs at most; steps of tensions, over what bends the arm by 1 rad, at first, at least, and of
# one that is the last; how much of the violation of targets a step has to make up for.
_ROUNDS, _FIRST, _LEAST, _CONVERGED, _LESS = 25, 2.0, 1e-3, 1e-6, 0.9
# The share of a stability margin that an optimum has to have.
_CLOSE = 1 - 1e-6
# Forces that do not press, over what bends the arm by 1 rad.
_PRESSED = 1e-8
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
    violation : float
        Of targets; 0 where they are met.
    optimality : Optimality
    least : float
        The stability that it was constrained to; 0 without.
    """

    here: Linearised
    steps: LoadPath
    violation: float
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
        begin = None if near is None else Collocated(near, self.map.refinement)
        here = self.map.led(tensions, begin, jumps=False).settled.here
        check_stretch(Collocated(here, self.map.refinement))
        return here

    def along(self, load_path: LoadPath) -> Linearised:
        """Return the equilibrium at the end of a load path; raises what settling does."""
        here = None
        for T in load_path:
            check_time()
            here = self.settled(np.array(T), here)
        assert here is not None
        return here

    def optimum(self, here: Linearised, least: float = 0.0) -> Optimum | None:
        """Return the optimum that programs lead to from an equilibrium; None if they lead nowhere.

        With a stability of at least so much. Where targets cannot be met from there the one that
        violates them least. An optimum whose contacts do not press is one without them, too.
        """
        box, steps, before, last, free = _FIRST, [here.tensions], np.inf, None, False
        for _ in range(_ROUNDS):
            check_time()
            here = self.map.with_nodes(here, _NEAR)
            program = self._program(self._released(here) if free else here, least)
            z = self.unknowns(program, here)
            point = program.solve(z, box=box, near=last)
            if not point.met:
                point = program.solve(z, slacks=True, box=box)
            violation = program.slack(point.x)
            step = program.tensions(point.x) - here.tensions
            size = float(np.abs(step).max()) / program.force
            there = self._stepped(here, step) if point.met else None
            if there is None:
                box = min(box, size) / 4
                if box < _LEAST:
                    return None
                continue
            stays = size < _LEAST and bool(violation) and violation > _LESS * before
            here, before, last = there, violation, point
            steps.append(here.tensions)
            if size < _CONVERGED and not free and self._released(here) is not here:
                free, last = True, None
            elif size < _CONVERGED or stays:
                path = tuple(tuple(T.tolist()) for T in steps)
                return Optimum(here, path, violation, self.optimality(here, least), least)
        return None

    def optimality(self, here: Linearised, least: float) -> Optimality:
        """Return how far an equilibrium is from an optimum."""
        here = self.map.with_nodes(here, _NEAR)
        program = self._program(here, least)
        return program.optimality(self.unknowns(program, here))

    def _released(self, here: Linearised) -> Linearised:
        """Return an equilibrium whose points that do not press count as free; itself without."""
        touches, force = Touches.of(here.system), forces(here.system, here.states)
        least = _PRESSED * float(np.max(natural_tensions(self.task.arm)))
        light = touches.point & (force <= least)
        if not light.any():
            return here
        touches.point[light], touches.curve[light] = False, 0.0
        return Linearised(touches.on(here.system), here.x)

    def _stepped(self, here: Linearised, step: Array) -> Linearised | None:
        """Return the equilibrium a step of tensions further; None where the arm snaps."""
        try:
            return self.settled(here.tensions + step, here)
        except OctoplanError:
            return None

    @property
    def _holds(self) -> list[Hold]:
        return [target for target in self.task.targets if isinstance(target, Hold)]

    def _program(self, here: Linearised, least: float = 0.0) -> Program:
        task = self.task
        return Program(here.system, task.targets, task.allowed, least, sharp=True)

    def unknowns(self, program: Program, here: Linearised) -> Array:
        """Return the program's unknowns at an equilibrium, tangential forces the best ones."""
        z = program.guess(here.tensions, here.states)
        places = program.structure.tangential
        for i, hold in enumerate(self._holds):
            touches = touches_of(here)
            nodes = [here.system.mesh.node(t.s) for t in touches if t.obstacle == hold.obstacle]
            columns = places[i, np.array(nodes, dtype=int) - 1]
            z[columns] = Grasp.of(self.task.arm, touches, hold).best() / program.z_unit[columns]
        return z

    def wrench_left(self, here: Linearised) -> float:
        """Return what is left of the wrenches of holds, over their sizes."""
        left = 0.0
        for hold in self._holds:
            grasp = Grasp.of(self.task.arm, touches_of(here), hold)
            wrench = grasp.scaled(grasp.left(grasp.best()))
            left += float(np.linalg.norm(wrench)) / hold.size(self.task.arm)
        return left

    def is_stable(self, optimum: Optimum) -> bool:
        """Return whether an optimum is as stable as is asked."""
        return optimum.stability >= max(self.task.statement.margin * _CLOSE, 0.0)
