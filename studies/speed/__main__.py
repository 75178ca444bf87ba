"""Studies of speed and accuracy. Commands:

settle    time of equilibria and tip Jacobians, single, in batches and under loads, against SciPy
plan      time of certified plans, cold, along a path and for many sections, against SciPy
knob      accuracy of `settle` compared with the requested accuracy
accuracy  cost of accuracy for each integrator and mesh
effects   change of the paper's shapes by each effect, and its cost
follow    time of plans for a moving target
fit       time of a calibration against SciPy's least squares
sweep     time and memory of sweeps on one and two processes
live      frames per second of the live page while the user drags the target

`python -m studies.speed COMMAND --help` lists the options of a command.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module

# Module and function of each command.
COMMANDS = {
    name: (f"studies.speed.{name}", "main")
    for name in ("settle", "plan", "knob", "accuracy", "follow", "sweep", "live")
}
COMMANDS |= {"effects": ("studies.speed.settle", "effects"), "fit": ("studies.calibration", "fit")}


def main(argv: Sequence[str] | None = None) -> None:
    """Run one of the studies with its options."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.speed",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", choices=COMMANDS)
    parser.add_argument("options", nargs=argparse.REMAINDER)
    args = parser.parse_args(argv)
    module, function = COMMANDS[args.command]
    getattr(import_module(module), function)(args.options)


if __name__ == "__main__":
    main()
