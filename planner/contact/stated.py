"""The program that a task states on a mesh, and its terms at the end of a load path."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from model.errors import OctoplanError, SnapError
from model.paths import Array
from planner.contact.equilibria import equilibria
from planner.contact.load_path import LoadPath, followed, rubs
from planner.contact.program import Program
from planner.contact.quadratic import optimum_at
from planner.contact.settled_terms import SettledTerms, Settling
from planner.program.limits import natural_tensions
from planner.program.terms import stations_of
from planner.solve.task import Task

# Meshes on which a plan is searched for and finished.
ROUGH, FINE = 1, 2
# What places press at least where an arm would snap as they let go, over a unit of force.
_PRESSED = 1e-3


def along(program: Program, load_path: LoadPath) -> SettledTerms:
    """Return the terms at the end of a load path; raises what settling does."""
    *_, here = passing(program, load_path)
    return here


def passing(program: Program, load_path: LoadPath) -> Iterator[SettledTerms]:
    """Yield the terms at the tensions of a load path; against friction at the last ones alone."""
    if program.has_history:
        yield program.evaluate(np.array(load_path[-1]), None, None)
        return
    here: SettledTerms | None = program.evaluate(np.array(load_path[0]), None, None)
    for T in load_path[1:]:
        assert here is not None
        yield here
        here = followed(np.array(T), here, partial(_near, program))
        if here is None:
            raise SnapError(1.0, "the arm jumps on its load path")
    assert here is not None
    yield here


def _near(program: Program, tensions: Array, here: SettledTerms) -> SettledTerms | None:
    try:
        return program.evaluate(tensions, here, None)
    except OctoplanError:
        return None


def program_of(task: Task, refinement: int, history: LoadPath | None = None) -> Program:
    """Return the program on meshes of a refinement; with friction from the end of a load path."""
    before = (history or ()) if rubs(task.scene) else ()
    mesh = stations_of(task.arm, task.targets), refinement
    own = equilibria(task.arm, task.scene, *mesh, task.machine_code, before)
    units = natural_tensions(task.arm)
    total = np.inf if task.limits.total is None else task.limits.total
    low, high = np.array(task.allowed.lower), np.array(task.allowed.upper)
    asked = task.statement.least if task.statement.modes else 0.0
    pressed = _PRESSED if task.statement.modes and task.statement.floor else 0.0
    settling, more = Settling(own, task.targets, asked, pressed), (bool(before), asked)
    return Program(settling.at, low, high, total, float(units.max()), units, *more)


def tip_of(terms: SettledTerms) -> Array:
    """Return where the tip is (3,) [m]."""
    system = terms.here.system
    return np.asarray(terms.here.states[system.of.nodes[-1, 4:7]])


def optimality_of(task: Task, tensions: Array, load_path: LoadPath = ()) -> float:
    """Return the residual of the first-order conditions at tensions (n_tendons,), scaled.

    Where a load path leads to.
    """
    program = program_of(task, FINE, load_path)
    try:
        return optimum_at(program, along(program, (*load_path, tuple(tensions.tolist())))).kkt
    except OctoplanError:
        return np.inf
