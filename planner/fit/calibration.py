"""A calibrated arm: what it predicts, plans of it, and what to measure next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from model.text import in_notebook
from planner.fit.fitted import Fitted
from planner.fit.measured import Measured
from planner.fit.predict import Candidate, LeftOut, Prediction, leave_out, predict, ranked
from planner.fit.report import outcome
from planner.fit.residuals import Residual
from planner.io.files import to_json, write_named
from planner.io.saved_records import calibration_record
from planner.plan import Plan, plan


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CalibratedPlan(Plan):
    """A plan of a calibrated arm.

    Attributes
    ----------
    tip_std : float
        One standard deviation of the tip's distance from where it is planned [m], by the standard
        errors of the arm's numbers.
    measured_std : float
        The same of where it would be measured, with what the model misses of shapes left out [m].
    """

    tip_std: float
    measured_std: float

    @property
    def outcome(self) -> str:
        """What was found, and how sure the tip is."""
        sure = f"tip sure to {1e3 * self.tip_std:.2g} mm (one standard deviation)"
        missed = f"{1e3 * self.measured_std:.2g} mm with what the model misses of measured shapes"
        return f"{super().outcome} By the calibration, {sure}, {missed}."


@dataclass(frozen=True)
class Calibration(Fitted):
    """A calibrated arm; see Fitted for what it holds."""

    @property
    def outcome(self) -> str:
        """What was found, how well it is known, and what to try."""
        return outcome(self)

    def predict(
        self, tensions: Any, points: Sequence[tuple[float, Any]] = (), session: str = ""
    ) -> Prediction:
        """Return where the tip and points (s [m], offset (3,) [m]) are under tensions, with bands.

        The band of the tip alone unless points are given.
        """
        return predict(self, tensions, points, session)

    def plan(self, targets: Any, **options: Any) -> Plan:
        """Return a plan of the calibrated arm, whose outcome tells how sure its tip is.

        Arguments are those of `plan`; the scene is the calibrated one.
        """
        found = plan(self.arm, targets, self.scene, **options)
        told = self.predict(found.tensions)
        measured = float(np.sqrt(np.trace(told.covariance[0])))
        own = {field.name: getattr(found, field.name) for field in fields(found)}
        return CalibratedPlan(**own, tip_std=told.tip_std, measured_std=measured)

    def next(self, candidates: Sequence[Any], session: str = "") -> tuple[Candidate, ...]:
        """Return sets of tensions, best first, by what measuring them tells of the unknowns.

        The markers are those of the session's first shape, or of the first; see Candidate.
        """
        return ranked(self, candidates, session)

    def leave_out(self, groups: Sequence[Any] | None = None) -> LeftOut:
        """Return how well shapes are predicted by fits without them.

        One by one, or all shapes with the same label of `groups` (one for each shape) together.
        """
        return leave_out(self, groups)

    def errors(self, measured: Sequence[Measured]) -> tuple[Residual, ...]:
        """Return what is predicted less what was measured of other shapes of this arm."""
        names = [m.name or f"measured[{i}]" for i, m in enumerate(measured)]
        shapes = [m.checked(self.given_arm, n) for m, n in zip(measured, names, strict=True)]
        return self.experiment(shapes).from_rest(self.array).named()

    def save(self, path: str | Path) -> Path:
        """Write the calibration to a .json file, which `load_calibration` reads."""
        return write_named(path, ".json", to_json(calibration_record(self)))

    def _repr_html_(self) -> str:
        return in_notebook(self)

    def plot(self, ax: Any = None) -> Any:
        """Draw markers over settled arms, residuals as they were measured, and standard errors.

        Residuals alone in `ax`, if it is given. Returns a new Figure, or the axes.
        """
        from planner.plots.results import plot_calibration

        return plot_calibration(self, ax=ax)
