"""octoplan design: the arm for which several tasks take least effort."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from planner.commands.answer import NOT_REACHED, OK, Answer
from planner.commands.options import FileOptions
from planner.fit.designed import Design
from planner.fit.files import run_design
from planner.io.saved_records import design_record


def design(
    file: Annotated[Path, Parameter(help="design file, FILE.toml")],
    /,
    *,
    options: FileOptions | None = None,
) -> Answer:
    """Find the arm for which several tasks take least effort."""
    result = run_design(file)
    code = OK if result.feasible else NOT_REACHED
    record = design_record(result)
    return Answer(code, lambda: _text(result), record, "design", lambda: _draw(result))


def _text(result: Design) -> str:
    width = max(len(own.name) for own in result.unknowns)
    rows = zip(result.unknowns, result.values, result.parameters.start, strict=True)
    lines = [
        f"  {own.name:<{width}}  {value:.5g} (was {old:.5g}) {result.parameters.unit(own)}".rstrip()
        for own, value, old in rows
    ]
    efforts = ", ".join(f"{own.effort:.4g}" for own in result.plans)
    return "\n".join([result.outcome, *lines, f"  efforts of the tasks [N]: {efforts}"])


def _draw(result: Design) -> Any:
    from planner.plots.plan import plot_together

    return plot_together(result.plans)
