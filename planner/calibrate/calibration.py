"""What a calibration found: the arm, how well it is known, and what it predicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from model.text import in_notebook
from planner.calibrate.fitted import Fitted
from planner.calibrate.leave_out import LeftOut, leave_out
from planner.calibrate.measured import Measured
from planner.calibrate.next_shapes import Candidate, ranked
from planner.calibrate.outcome import outcome
from planner.calibrate.predict import Prediction, predict
from planner.calibrate.residuals import Residual, residuals_of
from planner.files import to_json, write_named
from planner.records.calibration import calibration_record


@dataclass(frozen=True)
class Calibration(Fitted):
    """A calibrated arm; see Fitted for what it holds."""

    @cached_property
    def outcome(self) -> str:
        """What was found, how well it is known, and what to try."""
        return outcome(self)

    def predict(
        self, tensions: Any, points: Sequence[tuple[float, Any]] = (), session: str = ""
    ) -> Prediction:
        """Return where points (s [m], offset (3,) [m]) are under tensions, with bands.

        Their tip unless points are given.
        """
        return predict(self, tensions, points, session)

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
        found = self.experiment(shapes).at(self.array)
        return residuals_of(found)

    def save(self, path: str | Path) -> Path:
        """Write the calibration to a .json file, which `load_calibration` reads."""
        return write_named(path, ".json", to_json(calibration_record(self)))

    def _repr_html_(self) -> str:
        return in_notebook(self)

    def plot(self, ax: Any = None) -> Any:
        """Draw the residuals by marker and shape; returns the axes. Needs matplotlib."""
        from planner.plots.calibration import plot_residuals

        return plot_residuals(self, ax=ax)
