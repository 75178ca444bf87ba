"""How fast is it? A question each:

settle    settles and tip Jacobians, alone, in batches and under loads, against SciPy
plan      certified plans, cold, along a path and of many sections, against SciPy
knob      whether `settle` keeps to the accuracy that is asked for
accuracy  what accuracy costs, by integrator and mesh
effects   what each effect does to shapes, and what it costs
follow    plans that follow a moving target
fit       calibrations against SciPy's least squares
sweep     sweeps on two processes, killed and gone on with, and their memory
live      pictures a second of the live page while its target is dragged

`python -m studies.speed COMMAND --help` tells the options of one.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from importlib import import_module

# The module of each, and its function where that is not `main`.
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
