"""Are the map and its inverse fast enough for a microcontroller?

The paper calls its model "fast enough to implement on a microcontroller as virtual sensor or
internal model". This study exports the paper's statics, the arm of table 4 and the tensions of
figure 15 as C code, compiles the code for a Cortex-M7, checks the results against Python and counts
instructions in QEMU. The same is done for the inverse, which follows a tip target around a circle
of 15 mm in 50 steps of about 2 mm.

Assumptions: 480 MHz and one instruction per cycle. A Cortex-M7 can issue two instructions per
cycle, but waits for slow memory, and divisions, roots and most operations in double precision take
several cycles. The rates are orders of magnitude, above all in double precision.

Answer: in studies/README.md.

    python -m studies.microcontroller [SCENE.toml] [--precision float] [--accuracy 1e-3] [--inverse]

Requires arm-none-eabi-gcc with newlib, and qemu-system-arm.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from octoplan.model import Arm, Scene
from octoplan.planner import Plan, export, plan
from octoplan.planner.frontends.c_code.export import export_plan
from octoplan.planner.frontends.io.scene_file import load
from octoplan.planner.targets import TipPosition
from studies.reporting import asked

TOOLS = ("arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm")
HERTZ = 480e6
# Tip target of the inverse [m].
TARGET = (0.20, 0.15, -0.20)
# Largest tension of each tendon [N].
MAXIMUM = 20.0
_FIGURE_15 = Path(__file__).parent / "scenes" / "figure_15.toml"
_BOARD = Path(__file__).parent / "cortex_m7"
_TARGET = ("-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard", "-mthumb", "-O2")
_STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
_QEMU = ("-M", "mps2-an500", "-nographic", "-icount", "shift=0", "-semihosting-config", "enable=on")


@dataclass(frozen=True)
class Cost:
    """Memory and instructions of the exported functions on the processor.

    Attributes
    ----------
    flash, static : int
        Sizes of code and tables, and of work arrays [bytes].
    instructions, stack : dict
        Instructions [-] and stack [bytes] of one call of "tip", "nodes" and "jacobian".
    """

    flash: int
    static: int
    instructions: dict[str, int]
    stack: dict[str, int]


class DisagreesError(Exception):
    """The processor computes another result than the test vector; see the program's message."""


def missing() -> str:
    """Return the names of the tools that are not installed."""
    return ", ".join(tool for tool in TOOLS if shutil.which(tool) is None)


def measured(arm: Arm, scene: Scene, tensions: Any, accuracy: float, precision: Any) -> Cost:
    """Return the cost of an exported scene.

    Raise DisagreesError if the processor does not reproduce the test vector.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        export(arm, scene, folder, tensions, accuracy, precision)
        test = run(build(folder, folder / "main.c"))
        if test.returncode != 0:
            raise DisagreesError(test.stdout + test.stderr)
        lines = [
            line.split() for line in run(build(folder, _BOARD / "bench.c")).stdout.splitlines()
        ]
        return Cost(
            *_size(folder, "arm"),
            {name: int(count) for name, count, _ in lines},
            {name: int(depth) for name, _, depth in lines},
        )


@dataclass(frozen=True)
class InverseCost:
    """Memory [bytes] as in Cost, and mean and largest number of instructions of a new plan."""

    flash: int
    static: int
    mean: int
    most: int
    stack: int


def measured_inverse(p: Plan, accuracy: float, precision: Any) -> InverseCost:
    """Return the cost of the exported inverse of a plan.

    Raise DisagreesError if the processor does not reproduce the test vector, or misses a target of
    the circle.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        export_plan(p, folder, accuracy, precision)
        for main in (folder / "plan_main.c", _BOARD / "bench_plan.c"):
            result = run(build(folder, main))
            if result.returncode != 0:
                raise DisagreesError(result.stdout + result.stderr)
        sizes = [_size(folder, part) for part in ("arm", "arm_plan")]
        mean, most, stack = map(int, result.stdout.split()[:3])
        return InverseCost(sum(s[0] for s in sizes), sum(s[1] for s in sizes), mean, most, stack)


def _size(folder: Path, part: str) -> tuple[int, int]:
    """Compile a file; return the sizes of code and tables, and of work arrays [bytes]."""
    compiled = folder / f"{part}.o"
    _call("arm-none-eabi-gcc", *_TARGET, *_STRICT, "-c", folder / f"{part}.c", "-o", compiled)
    text, data, bss = _call("arm-none-eabi-size", compiled).splitlines()[1].split()[:3]
    return int(text) + int(data), int(data) + int(bss)


def build(folder: Path, main: Path) -> Path:
    """Build a program for the processor from a main file and the exported code in a folder."""
    program = folder / f"{main.stem}.elf"
    link = (
        "-nostartfiles",
        "--specs=rdimon.specs",
        "-T",
        _BOARD / "layout.ld",
        "-Wl,--gc-sections",
    )
    parts = [path for part in ("arm", "arm_plan") if (path := folder / f"{part}.c").exists()]
    sources = (main, *parts, _BOARD / "start.c")
    options = (
        *_TARGET,
        *_STRICT[:4],
        "-ffunction-sections",
        "-fdata-sections",
        f"-I{folder}",
        f"-I{_BOARD}",
    )
    _call("arm-none-eabi-gcc", *options, *sources, *link, "-lm", "-o", program)
    return program


def run(program: Path) -> subprocess.CompletedProcess[str]:
    """Run a program on the emulated board; return its output and exit code."""
    command = ["qemu-system-arm", *_QEMU, "-kernel", str(program)]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
    )


def _call(*command: object) -> str:
    return subprocess.run(
        [str(c) for c in command], capture_output=True, text=True, check=True
    ).stdout


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table."""
    args = asked(
        __doc__,
        argv,
        {
            "scene": (_FIGURE_15, {"help": "a scene file", "nargs": "?"}),
            "--precision": ["float", "double"],
            "--accuracy": [1e-3, 1e-6],
            "--inverse": (False, {"help": "measure a new plan instead of the map"}),
        },
    )
    if missing():
        print(f"not measured, because these tools are not installed: {missing()}")
        return
    request = load(args.scene)
    if args.inverse:
        _print_inverse(request.arm, request.scene, args.precision)
        return
    print(
        f"{'type':<8}{'accuracy':>9}{'flash':>9}{'static':>9}{'stack':>7}"
        f"{'tip pose':>20}{'tip Jacobian':>22}"
    )
    for precision in args.precision:
        for accuracy in args.accuracy:
            cost = measured(request.arm, request.scene, request.tensions, accuracy, precision)
            cells = [
                f"{cost.instructions[name]:>8} = {HERTZ / cost.instructions[name] / 1e3:>4.1f} kHz"
                for name in ("tip", "jacobian")
            ]
            sizes = f"{cost.flash / 1e3:>6.1f} kB{cost.static / 1e3:>6.1f} kB"
            stack = max(cost.stack.values())
            print(f"{precision:<8}{accuracy:>9.0e}{sizes}{stack:>5} B{cells[0]:>20}{cells[1]:>22}")


def _print_inverse(arm: Arm, scene: Scene, precisions: Sequence[Any]) -> None:
    """Print the cost of a new plan."""
    head = f"{'type':<8}{'accuracy':>9}{'flash':>9}{'static':>9}{'stack':>7}"
    print(f"{head}{'new plan':>20}{'largest':>10}")
    p = plan(arm, TipPosition(TARGET), scene, MAXIMUM)
    if not p.reached:
        print(f"no inverse: {p.outcome}")
        return
    for precision in precisions:
        accuracy = 1e-4 if precision == "float" else 1e-6
        result = measured_inverse(p, accuracy, precision)
        sizes = f"{result.flash / 1e3:>6.1f} kB{result.static / 1e3:>6.1f} kB{result.stack:>5} B"
        rate = f"{result.mean:>9} = {HERTZ / result.mean:>4.0f} Hz"
        print(f"{precision:<8}{accuracy:>9.0e}{sizes}{rate:>20}{result.most:>10}")


if __name__ == "__main__":
    main()
