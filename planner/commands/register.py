"""The register of commands: a new one is an import and a line here."""

from planner.commands import (
    calibrate,
    design,
    effects,
    export,
    live,
    new,
    plan,
    schema,
    settle,
    stiffness,
    sweep,
    trajectory,
)

COMMANDS = (
    new.COMMAND,
    plan.COMMAND,
    trajectory.COMMAND,
    settle.COMMAND,
    stiffness.COMMAND,
    live.COMMAND,
    effects.COMMAND,
    sweep.COMMAND,
    calibrate.COMMAND,
    design.COMMAND,
    export.COMMAND,
    schema.COMMAND,
)
