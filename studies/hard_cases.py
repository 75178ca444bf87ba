"""Does any hard case give a wrong result without a message?

Questions: How large is the worst error of random members of families of hard cases (slender tips,
any tension, many turns, strong compression, 1 to 160 tendons, derivatives at kinks, other units,
rotated scenes, heavy loads, stiff friction, ill-posed plans, hanging arms, helical tendons, long
thin bars, nearly singular allocations), compared with independent programs?
How many are refused, and how long do the members take? How do errors grow along the arm if strains
are integrated from the base to the tip instead of from the tip to the base?

Assumptions: The families and tolerances are those of the tests in `tests/core/hard_cases`. Each
family is described in its file, and its test runs the members. Errors are relative, or relative to
the arm's length.

Command: python -m studies.hard_cases [--members 12] [--family NAME ...] [--out out]

Answer: in studies/README.md.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from octoplan.model.paths import Array
from studies.reporting import asked, keep_finished, lettered

_ROOT = Path(__file__).parents[1]
_TEST = "tests/core/hard_cases/test_families.py::test_members_are_right_or_refused"
_LEAST = 1e-17


@dataclass(frozen=True)
class Verdict:
    """The result of a member: the error or the reason for the refusal, and the time [s]."""

    error: float
    refusal: str
    seconds: float
    passes: bool


@dataclass(frozen=True)
class Family:
    """A family of hard cases with its tolerance and the verdicts of its members."""

    name: str
    tolerance: float
    verdicts: tuple[Verdict, ...]


def names() -> list[str]:
    """Return the names of the families, in the order of the tests."""
    # The project's pytest settings contain one -q; a second -q would omit the names.
    listed = _pytest("--collect-only", _TEST).splitlines()
    ids = [line.split("[", 1)[1] for line in listed if line.startswith(_TEST + "[")]
    return [each.removesuffix("-0]") for each in ids if each.endswith("-0]")]


def family(name: str, members: int) -> Family:
    """Run the test of a family and return its verdicts."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        options = ("--members", str(members), "--junitxml", str(report))
        # The report format xunit1 contains the properties of a test.
        _pytest(f"{_TEST}[{name}-0]", *options, "-o", "junit_family=xunit1")
        properties = {
            each.get("name"): each.get("value", "") for each in ET.parse(report).iter("property")
        }
    verdicts = (Verdict(*each) for each in json.loads(properties["verdicts"]))
    return Family(name, float(properties["tolerance"]), tuple(verdicts))


def _pytest(*words: str) -> str:
    # Slow families are members, too.
    options = ["-n0", "-m", "", "-p", "no:cacheprovider"]
    command = [sys.executable, "-m", "pytest", *options, *words]
    done = subprocess.run(command, cwd=_ROOT, capture_output=True, text=True, check=False)
    # Return code 1: a member is wrong. The table reports this member.
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stdout + done.stderr)
    return done.stdout


def table_line(each: Family) -> str:
    """Return the line of a family in the table."""
    settled = [verdict.error for verdict in each.verdicts if not verdict.refusal]
    wrong = sum(not verdict.passes for verdict in each.verdicts)
    worst = max(settled, default=0.0)
    refused = len(each.verdicts) - len(settled)
    seconds = sum(verdict.seconds for verdict in each.verdicts)
    return (
        f"{each.name:<24}{len(each.verdicts):>8}{worst:>13.1e}{each.tolerance:>11.0e}"
        f"{refused:>9}{wrong:>7}{seconds:>9.1f}"
    )


def draw(table: list[Family], growth: Sweeps) -> Figure:
    """Return the figure: errors of all members, and growth of errors along the arm."""
    figure = Figure(figsize=(9.6, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    titles = ("members of each family", "initial error of 1e-9")
    lettered(zip((left, right), titles, strict=True))
    _draw_families(left, table)
    _draw_sweeps(right, growth)
    return figure


def _draw_families(ax: Axes, table: list[Family]) -> None:
    for i, each in enumerate(table):
        errors = [max(one.error, _LEAST) for one in each.verdicts if not one.refusal]
        spread = i + np.linspace(-0.25, 0.25, len(errors))
        ax.plot(errors, spread, "o", color="#1f6fb4", ms=4, alpha=0.6)
        ax.plot([each.tolerance] * 2, [i - 0.4, i + 0.4], color="#b3123f", lw=2)
        refused = len(each.verdicts) - len(errors)
        if refused:
            ax.text(2 * each.tolerance, i, f"{refused} refused", va="center", fontsize="small")
    ax.plot([], [], "o", color="#1f6fb4", ms=4, label="a member")
    ax.plot([], [], color="#b3123f", lw=2, label="allowed")
    ax.set_yticks(range(len(table)), [each.name for each in table])
    ax.set(xscale="log", xlim=(_LEAST / 2, 1e-3), xlabel="error")
    ax.invert_yaxis()
    ax.legend(fontsize="small", loc="upper right", frameon=False)


def _draw_sweeps(ax: Axes, growth: Sweeps) -> None:
    ax.plot(growth.s, growth.from_tip, color="#1f6fb4", label="from the tip")
    ax.plot(growth.s, growth.from_base, color="#e8912c", label="from the base")
    ax.plot(growth.s, growth.predicted, "k--", lw=1, label="from the base, D(base) / D(s)")
    ax.set(
        yscale="log",
        xlabel="s [m]",
        ylabel="error of curvature times radius [-]",
    )
    ax.legend(fontsize="small", frameon=False)


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table and save the figure."""
    args = asked(
        __doc__,
        argv,
        {
            "--members": 12,
            "--family": (None, {"help": "names of families; default: all", "nargs": "*"}),
            "--out": Path("out"),
        },
    )
    print(f"{'family':<24}{'members':>8}{'worst error':>13}{'tolerance':>11}", end="")
    print(f"{'refused':>9}{'wrong':>7}{'time [s]':>9}", flush=True)
    table: list[Family] = []
    with keep_finished():
        for name in args.family or names():
            table.append(family(name, args.members))
            print(table_line(table[-1]), flush=True)
    for each in table:
        for seed, verdict in enumerate(each.verdicts):
            if not verdict.passes:
                print(f"{each.name}, seed {seed}: {verdict.refusal or verdict.error}")
    growth = sweeps()
    print(f"growth of an initial error: {growth.up:.3g} times from tip to base,", end=" ")
    print(f"{growth.down:.4g} times from base to tip; D(base) / D(tip) {growth.ratio:.4g}")
    draw(table, growth).savefig(args.out / "hard_cases.png", dpi=130)


# The arm of table 4: length [m], radius at base and tip [m], Young's modulus [Pa].
L = 0.45
BASE = 15e-3
TIP = 2e-3
E = 110e3
# The tendon that ends at the tip: offset at base and tip [m], tension [N].
OFFSET = 7.5e-3
END = 1e-3
PULL = 1e-2
# Initial error of curvature times the radius of the base [-].
_OFF = 1e-9
_POINTS = 200


@dataclass(frozen=True, eq=False)
class Sweeps:
    """Errors of curvature times the radius of the base, at arc lengths s (N,) [m].

    Attributes
    ----------
    from_tip, from_base, predicted : (N,)
        Errors of both directions for an initial error of 1e-9; 1e-9 times D(base) / D(s).
    up, down, ratio : float
        Final error relative to the initial error, tip to base and base to tip; D(base) / D(tip).
    """

    s: Array
    from_tip: Array
    from_base: Array
    predicted: Array
    up: float
    down: float
    ratio: float


def _section(s: Array | float) -> tuple[Array, Array, Array, Array]:
    """Return D = E J + y^2 T, its derivative, y T and its derivative at s."""
    R = BASE + (TIP - BASE) * s / L
    y = OFFSET + (END - OFFSET) * s / L
    R_rate = (TIP - BASE) / L
    y_rate = (END - OFFSET) / L
    D = E * np.pi * R**4 / 4 + y**2 * PULL
    rate = E * np.pi * R**3 * R_rate + 2 * y * y_rate * PULL
    return np.asarray(D), np.asarray(rate), np.asarray(y * PULL), np.asarray(y_rate * PULL)


def sweeps() -> Sweeps:
    """Return both sweeps, each from the closed form k = y T / D plus an initial error."""
    s = np.linspace(0.0, L, _POINTS)
    D, _, moment, _ = _section(s)
    wanted = moment / D

    def rate(x: float, k: Array) -> Array:
        D, D_rate, _, moment_rate = _section(x)
        return (moment_rate - D_rate * k) / D

    def run(begin: float, end: float) -> Array:
        places = s if begin < end else s[::-1]
        start = [np.interp(begin, s, wanted) + _OFF / BASE]
        tight = {"rtol": 1e-13, "atol": 1e-16}
        result = solve_ivp(rate, (begin, end), start, "DOP853", t_eval=places, **tight).y[0]
        return np.asarray(result if begin < end else result[::-1])

    up = run(L, 0.0)
    down = run(0.0, L)
    from_tip = np.abs(up - wanted) * BASE
    from_base = np.abs(down - wanted) * BASE
    return Sweeps(
        s,
        from_tip,
        from_base,
        _OFF * D[0] / D,
        float(from_tip[0] / _OFF),
        float(from_base[-1] / _OFF),
        float(D[0] / D[-1]),
    )


if __name__ == "__main__":
    main()
