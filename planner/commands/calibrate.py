"""octoplan calibrate: numbers of an arm from measured shapes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from planner.commands.answer import OK, Answer
from planner.commands.options import FileOptions
from planner.fit.calibration import Calibration
from planner.fit.files import load_asked
from planner.io.saved_records import calibration_record


def calibrate(
    file: Annotated[Path, Parameter(help="calibration file, FILE.toml")],
    /,
    *,
    leave_out: bool = False,
    options: FileOptions | None = None,
) -> Answer:
    """Find numbers of an arm from measured shapes.

    Parameters
    ----------
    leave_out
        Also tell how well fits predict shapes left out.
    """
    result = load_asked(file).run()

    record = calibration_record(result)
    return Answer(OK, lambda: _text(result, leave_out), record, "calibration", result.plot)


def _text(result: Calibration, leave_out: bool) -> str:
    width = max(len(own.name) for own in result.unknowns)
    rows = zip(result.unknowns, result.values, result.std, strict=True)
    lines = [
        f"  {own.name:<{width}}  {value:.6g} +- {std:.2g} {result.parameters.unit(own)}".rstrip()
        for own, value, std in rows
    ]
    if leave_out:
        error = 1e3 * result.leave_out().mean_error
        lines.append(f"  shapes left out are predicted to {error:.3g} mm in the mean")
    return "\n".join([result.outcome, *lines])
