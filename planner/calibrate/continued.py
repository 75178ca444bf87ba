"""Shapes at other values of the unknowns, from those at values nearby.

They begin where the derivatives by the unknowns say that they are; where that is too far off, on
the parabola that the equilibria half way there tell.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from model.equilibrium.by_numbers import ByNumbers
from model.equilibrium.forward import Collocation, Known
from model.equilibrium.linearised import Linearised
from model.equilibrium.newton import CLOSE, TURN, newton_many
from model.errors import OctoplanError
from model.paths import Array
from model.transcription.system import System
from model.unloaded.stretch import LEAST_STRETCH
from planner.unknowns.pulled import FARTHEST

Found = list[Linearised | None]


def from_rest(system: System, tensions: Array) -> Found:
    """Return the equilibria that the arm without loads comes to, tensions first, then the loads.

    They may be others than by drawing tensions, which tells; None where there are none.
    """
    forward = Collocation.on(system)
    found = [None if isinstance(h, OctoplanError) else h for h in forward.from_rest_many(tensions)]
    return [
        here if here and forward.stretch(here.states).min() > LEAST_STRETCH else None
        for here in found
    ]


def carried(heres: Sequence[Linearised], system: System, tensions: Array, looser: float) -> Found:
    """Return the equilibria of a system whose mesh differs; None where there are none."""
    on = Collocation.on(system)
    known = [Known(here.system, here.states) for here in heres]
    guesses = np.array([on.carried(T, here) for T, here in zip(tensions, known, strict=True)])
    return newton_many(system, tensions, 1.0, guesses, TURN, looser=looser).solutions


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
    given = system, tensions, 1.0, guesses, FARTHEST
    found = newton_many(*given, kept=kept, looser=looser).solutions
    lost = [k for k, here in enumerate(found) if here is None]
    return _completed(found, lost, system, tensions, guesses[lost], looser)


def _completed(
    found: Found, lost: list[int], system: System, tensions: Array, guesses: Array, looser: float
) -> Found:
    """Return what was found with what is near guesses for those that were lost, by longer steps."""
    if lost:
        again = newton_many(system, tensions[lost], 1.0, guesses, looser=looser).solutions
        for k, here in zip(lost, again, strict=True):
            found[k] = here
    return found
