"""Newton's method in machine code for many sets of tensions at once, a few in each vector.

As `equilibrium` and `newton` do it, for arms that neither friction nor contact couples: what they
would have to follow in steps is left to them.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from model.cross_section.law import body_size
from model.cross_section.sections import SETTLED as SECTION_SETTLED
from model.cross_section.sections import STEPS as SECTION_STEPS
from model.cross_section.sections import body_kernel, tendon_kernel
from model.effects import ExactTendons
from model.equilibrium.load_stepping import CUTS, FIRST, FOLLOWED, LEAST_STEP
from model.equilibrium.newton import (
    CONTRACTION,
    NEAR,
    SETTLED,
    SMALL,
    STEPS,
    TURN,
    strain_scale,
)
from model.machine.lanes import LANES, aligned, loaded, padded, pointer, written
from model.machine.program import Program
from model.paths import Array
from model.time_limit import check_time
from model.transcription.collocation import gauss
from model.transcription.element import Form, element, lever, tip
from model.transcription.kernel import Kernel
from model.transcription.layout import POSE
from model.transcription.system import System

# Of equilibria.c: what changes go with besides strains.
_SIDES = 6
# Newton steps of a set, all told: what needs more is followed by itself.
_MOST = 200
# Sets between two looks at the clock: some tenths of a second.
_AT_ONCE = 512
Flags = NDArray[np.bool_]


class Found(NamedTuple):
    """What N sets of tensions come to.

    Attributes
    ----------
    states : (n_states, N)
    settled : (N,)
        Whether these are an equilibrium as it is looked for; else nothing is said.
    """

    states: Array
    settled: Flags


_COUNTS = ("steps", "cuts", "follows", "most_steps", "section_steps")


class _Arm(ctypes.Structure):
    """See equilibria.c."""

    _fields_ = [
        *((name, ctypes.c_long) for name in ("elements", "levers", "settles")),
        *(
            (name, ctypes.c_void_p)
            for name in (
                *("clamp", "tip", "element", "body", "path", "lever", "scale", "weight"),
                *("first", "tendon", "lever_at"),
            )
        ),
        *(
            (name, ctypes.c_double)
            for name in (
                *("start_load", "farthest", "settled", "contraction", "small"),
                *("nearest", "least_step", "first_load"),
            )
        ),
        *((name, ctypes.c_long) for name in _COUNTS),
        ("section_settled", ctypes.c_double),
    ]


def is_for(form: Form) -> bool:
    """Return whether equations of a form can be solved side by side."""
    return form.loaded and not form.friction and not form.contacts


def from_rest(system: System, tensions: Array, strains: Array) -> Found:
    """Return the stable equilibria that the arms without loads come to.

    Parameters
    ----------
    tensions : (n_tendons, N)
    strains : (N stages strains, N)
        Of the stages without loads by the paper's balance, from which those of an energy are found.

    Raises CompilerError.
    """
    settles = system.scene.has(ExactTendons)
    how = {"settles": settles, "start_load": 0.0, "farthest": TURN, "cuts": CUTS, "follows": 1}
    return _solved(system, tensions, strains, how)


def near(system: System, tensions: Array, strains: Array, farthest: float = NEAR) -> Found:
    """Return the equilibria near strains at the stages, as those of another mesh are.

    A step may turn a frame by `farthest`. As from_rest; raises CompilerError.
    """
    how = {"settles": 0, "start_load": 1.0, "farthest": farthest, "cuts": 0, "follows": 0}
    return _solved(system, tensions, strains, how)


def _solved(system: System, tensions: Array, strains: Array, how: dict[str, Any]) -> Found:
    of, M = system.of, tensions.shape[1]
    states, settled = np.empty((of.n_states, M)), np.zeros(M, dtype=bool)
    tables, run = _tables(system), _library(of.form)
    arm = _Arm(
        of.elements,
        len(of.levers),
        settled=SETTLED,
        contraction=CONTRACTION,
        small=SMALL,
        nearest=np.cos(FOLLOWED / 2),
        least_step=LEAST_STEP,
        first_load=FIRST,
        steps=STEPS,
        most_steps=_MOST,
        section_steps=SECTION_STEPS,
        section_settled=SECTION_SETTLED,
        **{name: pointer(table) for name, table in tables.items()},
        **how,
    )
    # Of each element what its elimination leaves, then states, their changes and the tensions.
    inside, w = of.stage_size, of.form.wrench
    eliminated = POSE * (_SIDES + inside) + _SIDES * (inside + w + 1)
    rows = (of.elements + 1) * eliminated + 5 * of.n_states + of.n_tendons
    space = aligned(rows * LANES)
    for first in range(0, M, _AT_ONCE):
        check_time()
        now = slice(first, min(first + _AT_ONCE, M))
        T, v = padded(tensions[:, now]), padded(strains[:, now])
        n = T.shape[1]
        x, found = np.empty((of.n_states, n)), np.zeros(n)
        given = (pointer(part) for part in (T, v, space, x, found))
        run(ctypes.c_long(n), of.n_tendons, ctypes.byref(arm), *given)
        count = now.stop - first
        states[:, now], settled[now] = x[:, :count], found[:count] > 0
    return Found(states, settled)


def _tables(system: System) -> dict[str, Any]:
    """Return the numbers of an arm as C takes them."""
    of, m = system.of, system.of.form.stages
    names = {"clamp": "clamp", "tip": "tip", "element": "element", "body": "body", "path": "tendon"}
    tables = {
        own: np.ascontiguousarray(system.p[of.equations.numbers_of(name)])
        for own, name in names.items()
    }
    stage, tendon = of.crossings
    counts = np.bincount(stage, minlength=of.elements * m)
    levers = system.p[of.equations.numbers_of("lever")] if of.levers else np.zeros(0)
    return tables | {
        "lever": np.ascontiguousarray(levers),
        "scale": strain_scale(of, system.arm.length),
        "weight": gauss(m).b,
        "first": np.concatenate([[0], np.cumsum(counts)]).astype(np.int32),
        "tendon": tendon.astype(np.int32),
        "lever_at": np.array(of.levers, np.int32),
    }


@lru_cache(maxsize=32)
def _library(form: Form) -> Any:
    law, own = form.law, element(form)
    sizes = {
        "LANES": LANES,
        "STAGES": form.stages,
        "STRAINS": form.strains,
        "WRENCH": form.wrench,
        "N_BODY": body_size(law),
        "N_ELEMENT": own.c.numel(),
    }
    programs = [
        written(Program(body_kernel(law)), "body", (1,)),
        written(Program(tendon_kernel(law)), "tendon", (1,)),
        written(Program(own.value), "element", (1,), pieces=True),
        *_with_jacobian(own, "element_jacobian", ""),
        *_with_jacobian(tip(form), "tip", "TIP_"),
        *_with_jacobian(lever(), "lever", "LEVER_"),
    ]
    run = loaded("equilibria.c", sizes, programs, "-O2").equilibria
    run.restype = None
    return run


def _with_jacobian(kernel: Kernel, name: str, prefix: str) -> list[str]:
    """Return a kernel with the nonzeros of its Jacobian in C, and their places."""
    jacobian, rows, columns = kernel.jacobian
    y, c = ca.SX.sym("y", kernel.y.numel()), ca.SX.sym("c", kernel.c.numel())
    both = ca.Function(name, [y, c], [kernel.value(y, c), jacobian(y, c)], {"cse": True})
    program = written(Program(both), name, (1,), pieces=both.n_instructions() > 1000)
    places = [
        f"static const int {prefix}{which}[] = {{{', '.join(map(str, own.tolist()))}}};"
        for which, own in (("ROW", rows), ("COLUMN", columns))
    ]
    return [f"#define N_{prefix}NONZEROS {rows.size}", *places, program]
