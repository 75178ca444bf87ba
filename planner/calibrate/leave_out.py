"""How well shapes are predicted by fits that have not seen them."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

from model import InputError
from model.progress import tell
from planner.calibrate.experiment import Evaluation
from planner.calibrate.fit import fit
from planner.calibrate.fitted import Fitted
from planner.calibrate.predict import predicted
from planner.calibrate.residuals import Residual, mean_distance, residuals_of


@dataclass(frozen=True)
class LeftOut:
    """Shapes that were left out, as the others predict them.

    Attributes
    ----------
    residuals : tuple of Residual
        Of all shapes, each by the fit without it.
    values : tuple of tuple of float
        Of the unknowns, by fit.
    held : tuple of bool
        Whether each marker lies in its 95 % band.
    """

    residuals: tuple[Residual, ...]
    values: tuple[tuple[float, ...], ...]
    held: tuple[bool, ...]

    @property
    def mean_error(self) -> float:
        """Mean distance of markers and tips from where they are predicted [m]."""
        return mean_distance(self.residuals)


def leave_out(of: Fitted, groups: Sequence[Hashable] | None) -> LeftOut:
    """See Calibration.leave_out."""
    labels = list(range(len(of.measured))) if groups is None else list(groups)
    if len(labels) != len(of.measured):
        raise InputError("groups", len(labels), f"a label for each of {len(of.measured)} shapes")
    if len(set(labels)) < 2:
        raise InputError("groups", labels, "two labels or more: some shapes have to stay")
    residuals: dict[int, tuple[Residual, ...]] = {}
    values, held = [], list[bool]()
    for count, label in enumerate(dict.fromkeys(labels)):
        tell("shapes left out", count, len(set(labels)))
        out = [i for i, own in enumerate(labels) if own == label]
        kept = [i for i in range(len(labels)) if i not in out]
        found = fit(_part(of, kept), of.weights)
        values.append(tuple(found.found.values.tolist()))
        without = replace(
            of, measured=tuple(of.measured[i] for i in kept), values=values[-1], noise=found.noise
        )
        for i in out:
            one = _part(of, [i])
            there = one.experiment.at(found.found.values, one)
            residuals[i] = residuals_of(there)
            if of.measured[i].seen:
                held += predicted(without, there).holds(of.measured[i].places).tolist()
    rows = tuple(row for i in range(len(labels)) for row in residuals[i])
    return LeftOut(rows, tuple(values), tuple(held))


def _part(of: Fitted, kept: Sequence[int]) -> Evaluation:
    """Return the evaluation of some of the shapes."""
    whole = of.evaluation
    part = of.experiment([of.measured[i] for i in kept])
    part.meshes.update(whole.experiment.meshes)
    return Evaluation(part, whole.values, whole.sessions, tuple(whole.heres[i] for i in kept))
