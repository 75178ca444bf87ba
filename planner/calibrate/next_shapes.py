"""Which shapes to measure next: those that tell most of the unknowns (D-optimal).

What a shape adds to the logarithm of the determinant of the information matrix,

    1/2 log det(I + J M^-1 J^T),    J of its residuals over the noise, M the information so far.

Source: Atkinson, Donev, Tobias, "Optimum Experimental Designs, with SAS" (2007), chapter 11.
The bounds count as a uniform distribution, so that M is regular.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from model import InputError
from planner.calibrate.experiment import UnsettledShapeError
from planner.calibrate.fitted import Fitted
from planner.calibrate.measured import Measured

# The variance of a uniform distribution from 0 to 1, inverted.
_UNIFORM = 12.0


class Candidate(NamedTuple):
    """A shape that could be measured.

    Its `place` among the candidates, tensions [N], what it tells [nats], and by what factor the
    standard errors (K,) shrink; a shape that does not settle tells nothing.
    """

    place: int
    tensions: tuple[float, ...]
    gain: float
    shrink: tuple[float, ...]


def ranked(of: Fitted, candidates: Sequence[Any], session: str) -> tuple[Candidate, ...]:
    """See Calibration.next."""
    given = list(candidates)
    if not given:
        raise InputError("candidates", candidates, "at least one set of tensions")
    sessions = {shape.session for shape in of.measured}
    if session and session not in sessions:
        raise InputError("session", session, ", ".join(sorted(sessions - {""})) or "none")
    like = next((m for m in of.measured if m.session == session), of.measured[0])
    J = of.scaled_jacobian
    M = J.T @ J + _UNIFORM * np.eye(J.shape[1])
    before = np.diag(np.linalg.inv(M))
    found = []
    for i, tensions in enumerate(given):
        flat = tuple(of.given_arm.flat(tensions, f"candidates[{i}]").tolist())
        shape = Measured(
            flat,
            *(like.points, like.frames, like.tip, like.lengths, like.strokes),
            session=session,
            name=f"candidates[{i}]",
            std=like.std,
            angle_std=like.angle_std,
        )
        try:
            there = of.experiment([shape]).at(of.array)
        except UnsettledShapeError:
            found.append(Candidate(i, flat, 0.0, (1.0,) * len(before)))
            continue
        rows = there.jacobian * of.parameters.range / of.noise
        more = M + rows.T @ rows
        gain = float(np.linalg.slogdet(more)[1] - np.linalg.slogdet(M)[1]) / 2
        shrink = np.sqrt(np.diag(np.linalg.inv(more)) / before)
        found.append(Candidate(i, flat, gain, tuple(shrink.tolist())))
    return tuple(sorted(found, key=lambda own: -own.gain))
