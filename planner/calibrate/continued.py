"""Shapes at other values of the unknowns, from those at values nearby.

They begin where the derivatives by the unknowns say that they are; where that is too far off, on
the parabola that the equilibria half way there tell.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from model.equilibrium import side_by_side
from model.equilibrium.by_numbers import ByNumbers
from model.equilibrium.forward import Collocation, Known, carried_strains
from model.equilibrium.linearised import Linearised
from model.equilibrium.many_tips import by_the_paper, least_stretch
from model.equilibrium.newton import CLOSE, TURN
from model.equilibrium.newton_many import newton_many
from model.equilibrium.side_by_side import Flags, is_for, near
from model.paths import Array
from model.transcription.system import System
from model.unloaded.stretch import LEAST_STRETCH
from planner.unknowns.pulled import FARTHEST

Found = list[Linearised | None]


def from_rest(system: System, tensions: Array) -> Found:
    """Return the equilibria that machine code comes to from the arm without loads.

    Its own tensions first, then the loads: it may be another than by drawing tensions, which tells.
    """
    found: Found = [None] * len(tensions)
    if not (system.of.form.machine_code and is_for(system.of.form)):
        return found
    T = tensions.T
    states, settled = side_by_side.from_rest(system, T, by_the_paper(system, T))
    stretch = least_stretch(system, states[system.of.stages.ravel()])
    return _linearised(system, tensions, states, settled & (stretch > LEAST_STRETCH))


def carried(heres: Sequence[Linearised], system: System, tensions: Array, looser: float) -> Found:
    """Return the equilibria of a system whose mesh differs; None where there are none."""
    found: Found = [None] * len(heres)
    if system.of.form.machine_code and is_for(system.of.form):
        before = heres[0].system
        strains = np.stack([before.strains(here.states) for here in heres], axis=-1)
        strains = carried_strains(before, strains, system).reshape(-1, len(heres))
        found = _linearised(system, tensions, *near(system, tensions.T, strains, TURN))
    on, lost = Collocation.on(system), [k for k, here in enumerate(found) if here is None]
    known = [Known(heres[k].system, heres[k].states) for k in lost]
    guesses = [on.carried(tensions[k], here) for k, here in zip(lost, known, strict=True)]
    return _completed(found, lost, system, tensions, np.array(guesses), looser)


def continued(
    by: Sequence[ByNumbers],
    change: Array,
    system: System,
    tensions: Array,
    halfway: Callable[[list[int]], tuple[System, Array]],
    looser: float,
) -> Found:
    """Return the equilibria after a change of the unknowns (K,); None where there are none.

    Parameters
    ----------
    by : sequence of ByNumbers
        Where they were.
    system : System
        After the change; `tensions` (N, n_tendons) are those then.
    halfway : callable
        Which of them -> the system after half of the change, and their tensions.
    looser : float
        Of Newton's method; see newton_many.
    """
    ahead = np.array([own.states @ change for own in by])
    found = _led(by, system, tensions, ahead, looser)
    lost = [k for k, here in enumerate(found) if here is None]
    if lost:
        own, (half, pulls) = [by[k] for k in lost], halfway(lost)
        middle = _led(own, half, pulls, ahead[lost] / 2, looser)
        met = [(k, here.states) for k, here in zip(lost, middle, strict=True) if here]
        left = [k for k, _ in met]
        bent = [4 * (states - by[k].here.states) - ahead[k] for k, states in met]
        ends = _led([by[k] for k in left], system, tensions[left], np.array(bent), looser)
        for k, here in zip(left, ends, strict=True):
            found[k] = here
    return found


def _led(
    by: Sequence[ByNumbers], system: System, tensions: Array, ahead: Array, looser: float
) -> Found:
    """Return the equilibria after changes of the states of about `ahead` (N, n_states)."""
    if not by:
        return []
    guesses = np.array([own.here.states for own in by]) + ahead
    turns = np.abs(ahead[:, system.of.nodes[:, :4].ravel()]).max(axis=1)
    kept = [own.here if turn < CLOSE else None for own, turn in zip(by, turns, strict=True)]
    form = system.of.form
    if form.machine_code and is_for(form):
        strains = guesses[:, system.of.stages.ravel()].T
        found = _linearised(system, tensions, *near(system, tensions.T, strains, FARTHEST))
    else:
        found = newton_many(system, tensions, guesses, FARTHEST, kept, looser).found
    lost = [k for k, here in enumerate(found) if here is None]
    return _completed(found, lost, system, tensions, guesses[lost], looser)


def _completed(
    found: Found, lost: list[int], system: System, tensions: Array, guesses: Array, looser: float
) -> Found:
    """Return what was found with what is near guesses for those that were lost, by longer steps."""
    if lost:
        again = newton_many(system, tensions[lost], guesses, looser=looser).found
        for k, here in zip(lost, again, strict=True):
            found[k] = here
    return found


def _linearised(system: System, tensions: Array, states: Array, settled: Flags) -> Found:
    pairs = zip(tensions, states.T, settled, strict=True)
    return [Linearised(system, system.x(T, 1.0, x)) if ok else None for T, x, ok in pairs]
