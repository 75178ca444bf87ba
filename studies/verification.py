"""How far is each result from an independent program or a closed form?

Question: For each capability, what does not use octoplan's equations or code, and how far is
octoplan's result from it at most?

Assumptions: The tests compute and record the deviations; this study runs these tests, all their
cases included, and takes the largest. Deviations are relative, or relative to the arm's length.
Rows named "members" are families of random hard cases, with a number of members each.

Command: python -m studies.verification [--members 12] [--rows WORD ...]

Answer: in docs/verification.rst.
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

from studies.reporting import asked, keep_finished

_ROOT = Path(__file__).parents[1]
_FAMILIES = "core/hard_cases/test_families.py::test_members_are_right_or_refused"


@dataclass(frozen=True)
class Row:
    """A capability, its independent reference, and the tests that compare both.

    Attributes
    ----------
    capability, reference : str
    tests : tuple of str
        Tests below `tests/`, or names of families of hard cases.
    """

    capability: str
    reference: str
    tests: tuple[str, ...]

    @property
    def nodes(self) -> list[str]:
        """The tests as arguments of pytest."""
        return [
            f"tests/{test}" if "::" in test else f"tests/{_FAMILIES}[{test}-0]"
            for test in self.tests
        ]


ROWS = (
    Row(
        "shapes without loads, the paper's statics",
        "DOP853 along the strains in closed form",
        ("slender tips", "many turns", "layouts"),
    ),
    Row(
        "the paper's figures, five statics",
        "another program",
        ("core/model/test_reference_tips.py::test_tip_is_that_of_the_independent_program",),
    ),
    Row(
        "cross-sections under any tension",
        "least energy by SciPy; closed forms",
        ("any tension, paper", "any tension, exact", "any tension, silicone"),
    ),
    Row(
        "compression up to collapse",
        "closed forms",
        ("compression, paper", "compression, exact", "compression, silicone"),
    ),
    Row("tip loads", "elastica by elliptic integrals; shooting", ("heavy loads", "long thin bars")),
    Row(
        "weight",
        "heavy elastica by shooting",
        ("core/effects/test_weight.py::test_a_bar_that_sags_far_is_the_heavy_elastica",),
    ),
    Row("hanging arms", "chain of links, pulled slowly", ("hanging",)),
    Row(
        "loads at points and per length",
        "shooting",
        ("core/effects/test_line_loads.py::test_loads_along_a_bar_agree_with_shooting",),
    ),
    Row("helical tendons", "balance of each cross-section by SciPy", ("helical tendons",)),
    Row("tendon friction", "capstan law as an initial value problem", ("stiff friction",)),
    Row(
        "spacer discs",
        "least energy of a rod with discs; capstan law",
        (
            "guides/test_guides.py::test_arm_with_discs_takes_the_shape_of_least_energy",
            "guides/test_guides.py::test_friction_at_discs_follows_the_capstan_law",
        ),
    ),
    Row(
        "tapered rectangular body under loads",
        "shooting, torsion by a double Fourier series",
        ("core/model/test_cross_sections.py::test_loaded_tapered_rectangle_agrees_with_shooting",),
    ),
    Row(
        "robot of another group, steel with discs",
        "another program",
        ("core/effects/test_other_robot.py::test_the_tip_is_where_the_other_program_has_it",),
    ),
    Row(
        "given tendon lengths",
        "least energy with inequalities by SciPy",
        (
            "lengths/test_minimisation.py::test_the_shape_is_of_least_energy",
            "lengths/test_minimisation.py::test_many_shapes_are_of_least_energy",
        ),
    ),
    Row(
        "contact: place and force",
        "elastica against a wall and around a cylinder",
        (
            "contact/test_closed_forms.py"
            "::test_a_tip_bent_against_a_wall_presses_as_the_elastica_does",
            "contact/test_closed_forms.py"
            "::test_a_strip_bent_round_a_cylinder_lies_on_its_arc_and_presses_at_its_ends",
        ),
    ),
    Row(
        "compliance, with held tensions and lengths",
        "differences of settled shapes",
        (
            "core/stiffness/test_against_differences.py"
            "::test_the_compliance_is_the_slope_of_settled_shapes",
        ),
    ),
    Row(
        "distances from obstacles [m]",
        "the library coal",
        ("obstacles/test_signed_distances.py::test_distances_are_those_of_coal",),
    ),
    Row(
        "effort of plans",
        "SLSQP in the tensions",
        (
            "core/planner/test_optima.py"
            "::test_no_tensions_near_a_plan_meet_its_tip_with_less_effort",
        ),
    ),
    Row(
        "tips of plans, ill-posed and nearly singular",
        "DOP853 along the strains in closed form",
        ("ill-posed plans", "nearly singular allocations"),
    ),
    Row(
        "exported MuJoCo model at rest",
        "simulation by MuJoCo",
        ("frontends/test_loads_in_mujoco.py::test_keyframe_stays_for_six_seconds_under_loads",),
    ),
)


@dataclass(frozen=True)
class Result:
    """The comparisons of a row: their number, the largest deviation, and how many are refused."""

    compared: int
    largest: float
    refused: int


def compare(row: Row, members: int) -> Result | None:
    """Run the tests of a row, and return the largest of the deviations that they record.

    Return None if a test fails or lacks an optional package.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        options = ["-n0", "-m", "", "--junitxml", str(report)]
        if any(_FAMILIES in node for node in row.nodes):
            options += ["--members", str(members)]
        # The report format xunit1 contains the properties of a test.
        command = [sys.executable, "-m", "pytest", *options, "-o", "junit_family=xunit1"]
        told = subprocess.run([*command, *row.nodes], cwd=_ROOT, capture_output=True, check=False)
        if told.returncode:
            return None
        properties = [
            (p.get("name"), p.get("value", "")) for p in ET.parse(report).iter("property")
        ]
    deviations = [float(value) for name, value in properties if name == "deviation"]
    verdicts = [
        verdict for name, value in properties if name == "verdicts" for verdict in json.loads(value)
    ]
    deviations += [error for error, refusal, _, _ in verdicts if not refusal]
    return Result(len(deviations), max(deviations), sum(bool(own[1]) for own in verdicts))


def main(argv: Sequence[str] | None = None) -> None:
    """Run the study."""
    args = asked(__doc__, argv, {"--members": 12, "--rows": (None, {"nargs": "*"})})
    print(f"{'capability':<46}{'reference':<48}{'compared':>9}{'refused':>9}{'deviation':>11}")
    with keep_finished():
        for row in ROWS:
            if args.rows and not any(word in row.capability for word in args.rows):
                continue
            result = compare(row, args.members)
            if result is None:
                numbers = f"  not verified: python -m pytest -m '' {' '.join(row.nodes)}"
            else:
                counts = f"{result.compared:>9}{result.refused:>9}"
                numbers = f"{counts}{result.largest:>11.1e}"
            print(f"{row.capability:<46}{row.reference:<48}{numbers}", flush=True)


if __name__ == "__main__":
    main()
