"""Invalid values raise InputError with field and rule; crushed arms raise CollapsedError."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from octoplan.model import (
    Anchorage,
    Arm,
    InputError,
    Linear,
    Material,
    OctoplanError,
    Sampled,
    Scene,
    settle,
    settle_many,
)
from octoplan.model.arm import conical
from octoplan.model.compliance import length_response
from octoplan.model.effects import Extension, Weight
from octoplan.model.extensions.clearance import clearance
from octoplan.model.support.errors import CollapsedError, ConvergenceError
from tests.oracles import Array, paper_rod, strain
from tests.refusals import Refused, check_refusal

ARM, REST = Arm.from_paper("table-2"), np.zeros(12)
THIN, BODY = Linear(1e-3, 1e-3), Linear(0.01, 0.01)
ONE = (Anchorage(0.3, THIN),)
FLAT4 = (1e-3,) * 4
INF, NAN = np.inf, np.nan
# Values beneath the mask were not measured.
MASKED = np.ma.array(np.full(12, 0.1), mask=np.arange(12) == 0)


def of(length: float = 0.3, radius: Any = (0.01, 0.01), rows: Any = ((0.3, 1e-3, 1e-3),)) -> Arm:
    return conical(length, radius, rows)


ARMS: Refused = {
    "no modulus": (lambda: Material(E=0), "Material.E", "above 0"),
    "negative modulus": (lambda: Material(E=-1e5), "Material.E", "above 0"),
    "infinite modulus": (lambda: Material(E=INF), "Material.E", "finite"),
    "modulus in words": (lambda: Material(E="soft"), "Material.E", "a number"),
    "no density": (lambda: Material(density=0), "Material.density", "above 0"),
    "nu of -1": (lambda: Material(nu=-1.0), "Material.nu", "above -1"),
    "nu below -1": (lambda: Material(nu=-1.5), "Material.nu", "above -1"),
    "nu above a half": (lambda: Material(nu=0.51), "Material.nu", "to 0.5"),
    "nu not a number": (lambda: Material(nu=NAN), "Material.nu", "finite"),
    "modulus out of this world": (lambda: Material(E=1e31), "Material.E", "to 1e+30"),
    "hardly any modulus": (lambda: Material(E=1e-31), "Material.E", "from 1e-30"),
    "no length": (lambda: of(length=0), "Arm.length", "above 0"),
    "negative length": (lambda: of(length=-0.3), "Arm.length", "above 0"),
    "no radius": (lambda: of(radius=(0.01, 0)), "Arm.radius", "s = 0.3 m"),
    "negative radius": (lambda: of(radius=(-0.01, 0.01)), "Arm.radius", "s = 0 m"),
    "radius not a number": (lambda: of(radius=(0.01, NAN)), "Linear", "finite"),
    "no sections": (lambda: of(rows=()), "Arm.sections", "at least one"),
    "sections from base to tip": (
        lambda: of(rows=((0.1, 1e-3, 1e-3), (0.3, 1e-3, 1e-3))),
        "Arm.sections[1].at",
        "below 0.1 m",
    ),
    "two sections at one place": (
        lambda: of(rows=((0.3, 1e-3, 1e-3), (0.2, 1e-3, 1e-3), (0.2, 1e-3, 1e-3))),
        "Arm.sections[2].at",
        "below 0.2 m",
    ),
    "section beyond the arm": (
        lambda: of(rows=((0.31, 1e-3, 1e-3),)),
        "Arm.sections[0].at",
        "up to the length 0.3 m",
    ),
    "section at the base": (lambda: of(rows=((0, 1e-3, 1e-3),)), "Anchorage.at", "above 0"),
    "tendon outside the base": (
        lambda: of(rows=((0.3, 0.0101, 1e-3),)),
        "Arm.sections[0].offset",
        "0.01 m at s = 0 m",
    ),
    "tendon outside the tip": (
        lambda: of(radius=(0.01, 2e-3), rows=((0.3, 3e-3, 3e-3),)),
        "Arm.sections[0].offset",
        "0.002 m at s = 0.3 m",
    ),
    "tendon outside on the other side": (
        lambda: of(rows=((0.3, -0.0101, 1e-3),)),
        "Arm.sections[0].offset",
        "0.01 m",
    ),
    "offset that is a number": (lambda: Anchorage(0.3, 1e-3), "Anchorage.offset", "Linear"),
    "no tendons": (lambda: Anchorage(0.3, THIN, ()), "Anchorage.angles", "at least one"),
    "angle not a number": (lambda: Anchorage(0.3, THIN, (NAN,)), "Anchorage.angles", "finite"),
    "left-handed base": (
        lambda: Arm(0.3, Linear(0.01, 0.01), ONE, base_frame=np.diag([1, 1, -1])),
        "Arm.base_frame",
        "right-handed",
    ),
    "stretched base": (
        lambda: Arm(0.3, Linear(0.01, 0.01), ONE, base_frame=1.1 * np.eye(3)),
        "Arm.base_frame",
        "orthonormal",
    ),
    "base in the plane": (
        lambda: Arm(0.3, Linear(0.01, 0.01), ONE, base_position=(0.0, 0.0)),
        "Arm.base_position",
        "3 numbers",
    ),
    "three samples": (lambda: Sampled((0, 0.1, 0.3), (1e-3,) * 3), "Sampled.s", "at least 4"),
    "samples in disorder": (lambda: Sampled((0, 2, 1, 3), FLAT4), "Sampled.s", "increasing"),
    "sample given twice": (lambda: Sampled((0, 1, 1, 3), FLAT4), "Sampled.s", "increasing"),
    "a value missing": (lambda: Sampled((0, 1, 2, 3), (1e-3,) * 3), "Sampled.values", "4 numbers"),
    "sample not a number": (lambda: Sampled((0, 1, 2, NAN), FLAT4), "Sampled.s", "finite"),
    "radius sampled short of the tip": (
        lambda: Arm(0.3, Sampled((0, 0.1, 0.2, 0.29), (0.01,) * 4), ONE),
        "Arm.radius.s",
        "samples from 0 to 0.3 m",
    ),
    "offset sampled from above the base": (
        lambda: Arm(
            0.3, Linear(0.01, 0.01), (Anchorage(0.2, Sampled((0.01, 0.1, 0.15, 0.2), FLAT4)),)
        ),
        "Arm.sections[0].offset.s",
        "samples from 0 to 0.2 m",
    ),
}
SETTLED: Refused = {
    "unknown arm": (lambda: Arm.from_paper("table-3"), "name", "table-2, table-4, section-5.1, "),
    "tendon of no number": (lambda: ARM.tendon_name("T_11"), "index", "from 0 to 11"),  # type: ignore[arg-type]
    "tendon before the first": (lambda: ARM.tendon_name(-1), "index", "from 0 to 11"),
    "tendon after the last": (lambda: ARM.tendon_name(12), "index", "from 0 to 11"),
    "radius at no number": (lambda: ARM.outer_radius("tip"), "s", "arc lengths"),  # type: ignore[arg-type]
    "effect by its name": (lambda: Scene().find("Weight"), "kind", "a kind of effect"),  # type: ignore[arg-type]
    "effect itself": (lambda: Scene().has(Weight()), "kind", "a kind of effect"),  # type: ignore[arg-type]
    "section 0": (lambda: ARM.tendons_of(0), "section", "from 1 to 3"),
    "section 4": (lambda: ARM.tendons_of(4), "section", "from 1 to 3"),
    "sections": (lambda: ARM.tendons_of(np.array([1, 2])), "section", "from 1 to 3"),  # type: ignore[arg-type]
    "tensions beyond the tip": (lambda: settle(ARM, REST).tension(0.32), "s", "from 0 to 0.31 m"),
    "tensions before the base": (lambda: settle(ARM, REST).tension(-0.1), "s", "from 0 to 0.31 m"),
    "clearance of a word": (lambda: clearance("shape"), "shape", "a Shape"),  # type: ignore[arg-type]
    "response of a word": (lambda: length_response("shape"), "shape", "a Shape"),  # type: ignore[arg-type]
    "response as printed": (
        lambda: length_response(settle(ARM, REST, Scene.as_printed())),
        "scene",
        "equations hold under loads",
    ),
    "an effect twice": (lambda: Scene(Extension(), Extension()), "Scene", "once"),
    "effect by name": (lambda: Scene("Extension"), "Scene effect 1", "Extension()"),
    "class of an effect": (lambda: Scene(Extension), "Scene effect 1", "Extension()"),
    "accuracy of 0": (lambda: settle(ARM, REST, accuracy=0), "accuracy", "from 1e-12 to 0.1"),
    "accuracy too fine": (lambda: settle(ARM, REST, accuracy=9e-13), "accuracy", "from 1e-12"),
    "accuracy too coarse": (lambda: settle(ARM, REST, accuracy=0.11), "accuracy", "to 0.1"),
    "accuracy not a number": (lambda: settle(ARM, REST, accuracy=NAN), "accuracy", "finite"),
    "accuracy in words": (lambda: settle(ARM, REST, accuracy="fine"), "accuracy", "a number"),
    "place before the base": (lambda: settle(ARM, REST).position(-1e-3), "s", "from 0 to 0.31 m"),
    "place beyond the tip": (lambda: settle(ARM, REST).frame([0, 0.32]), "s", "from 0 to 0.31 m"),
    "place not a number": (lambda: settle(ARM, REST).strain(NAN), "s", "finite"),
    "places in a table": (
        lambda: settle(ARM, REST).position(np.zeros((2, 2))),
        "s",
        "a list of numbers",
    ),
}
TEXT: Refused = {
    "Material.E": (lambda: Material(E="110e3"), "", ""),
    "Material.nu": (lambda: Material(nu="0.5"), "", ""),
    "Linear": (lambda: Linear("0.01", 0.02), "", ""),
    "Sampled": (lambda: Sampled(("0", "1", "2", "3"), (1, 1, 1, 1)), "", ""),
    "Arm.length": (lambda: Arm("0.3", BODY, ONE), "", ""),
    "Anchorage.at": (lambda: Anchorage("0.3", THIN), "", ""),
    "Anchorage.angles": (lambda: Anchorage(0.3, THIN, ("0", "1")), "", ""),
    "tensions": (lambda: settle(ARM, ["1"] * 12), "", ""),
    "tensions in one string": (lambda: settle(ARM, "123456789012"), "", ""),
    "accuracy": (lambda: settle(ARM, REST, accuracy="1e-3"), "", ""),
    "position": (lambda: settle(ARM, REST).position("0.1"), "", ""),
}
KINDS: Refused = {
    "radius a number": (lambda: Arm(0.3, 0.01, ONE), "", ""),
    "sections a number": (lambda: Arm(0.3, BODY, 3), "", ""),
    "section a tuple": (lambda: Arm(0.3, BODY, ((0.3, 1e-3, 1e-3),)), "", ""),
    "one section, no tuple": (lambda: Arm(0.3, BODY, ONE[0]), "", ""),
    "material by name": (lambda: Arm(0.3, BODY, ONE, "silicone"), "", ""),
    "offset a class": (lambda: Anchorage(0.3, Linear), "", ""),
    "scene by name": (lambda: settle(ARM, REST, "bare"), "", ""),
    "effect for a scene": (lambda: settle(ARM, REST, Extension()), "", ""),
    "arm by name": (lambda: settle("table-2", REST), "", ""),
    "many, nothing": (lambda: settle_many(ARM, None), "", ""),
    "many, one number": (lambda: settle_many(ARM, 1.0), "", ""),
    "by section, too few": (lambda: ARM.by_section(np.zeros(11)), "", ""),
    "preset by a list": (lambda: Arm.from_paper(["table-2"]), "", ""),
    "one radius of a cone": (lambda: of(radius=0.01), "radii", "R_max and R_min"),
    "one row of a cone": (lambda: of(rows=(0.3, 1e-3, 1e-3)), "anchorages", "rows"),
    "rows of a cone short": (lambda: of(rows=[(0.3, 1e-3)]), "anchorages", "l_i, a_i, b_i"),
    "paths without dimensions": (lambda: Anchorage(0.3, np.array(THIN)), "Anchorage.offset", ""),
    "tension without dimensions": (lambda: settle(ARM, np.array(0.1)), "tensions", "12 numbers"),
    "a tension that is masked": (lambda: settle(ARM, MASKED), "tensions", "12 numbers"),
    "many, one masked": (lambda: settle_many(ARM, MASKED[None]), "tensions[0]", "12 numbers"),
    "a modulus that is masked": (lambda: Material(E=MASKED[0]), "Material.E", "a number"),
    "many, without dimensions": (lambda: settle_many(ARM, np.array(0.1)), "tensions", "a set"),
    "many, by name": (lambda: settle_many(ARM, {"rest": REST}), "tensions", "a set"),
    "many, errors by a list": (lambda: settle_many(ARM, [REST], errors=["nan"]), "errors", "nan"),
    "places not in a row": (lambda: settle(ARM, REST).position([0.1, [0.2]]), "s", ""),
    "outside by tendon": (
        lambda: settle(ARM, REST, tendon_outside=np.ones(12)),
        "tendon_outside",
        "a number",
    ),
}
TABLES = {"arm": ARMS, "settle": SETTLED, "text": TEXT, "kind": KINDS}
CASES = {f"{t}: {name}": row for t, table in TABLES.items() for name, row in table.items()}


@pytest.mark.parametrize(("attempt", "field", "allowed"), CASES.values(), ids=CASES)
def test_it_is_refused_naming_field_and_what_is_allowed(
    attempt: Callable[[], object], field: str, allowed: str
) -> None:
    check_refusal(attempt, field, allowed)


def test_the_bounds_themselves_are_allowed() -> None:
    assert Material(nu=0.5).G == 110e3 / 3
    assert of(rows=((0.3, 0.01, 0.01),)).n_tendons == 4
    assert Sampled((0, 1, 2, 3), FLAT4).values == FLAT4
    assert settle(ARM, REST, accuracy=0.1).error <= 0.1
    assert settle(ARM, REST, accuracy=1e-12).error <= 1e-12
    assert settle(ARM, REST).position([0.0, 0.31]).shape == (2, 3)
    assert settle(ARM, REST).position([]).shape == (0, 3)


def test_values_that_say_the_same_are_the_same() -> None:
    assert hash(Material(E=np.array(1e5))) == hash(Material(E=1e5))
    effects = Scene.as_printed().effects
    assert Scene(*effects[::-1]) == Scene(*effects)


PAPER = Scene(Extension())
CRUSHING = np.array([0, 0, 0, 0, 0, 0, 0, 0, 20.0, 20, 20, 20])


def tensions(index: int, value: float) -> Array:
    T = np.ones(12)
    T[index] = value
    return T


NO_TENSION = "number from 0 to 1e+30"
SHAPED = "12 numbers, flat or a row per section, tip first (4+4+4)"
WRONG: dict[str, Any] = {
    "too few": np.zeros(11),
    "too many": np.zeros(13),
    "none": [],
    "columns for rows": np.zeros((4, 3)),
    "a set of sets": np.zeros((1, 12)),
    "a table of tables": np.zeros((3, 4, 1)),
    "ragged rows": [[0.0] * 4, [0.0] * 3, [0.0] * 5],
    "one number": 1.0,
    "nothing": None,
    "words": ["tight"] * 12,
    "complex numbers": [1j] * 12,
}
NOT_ALLOWED: Refused = {
    **{what: (partial(settle, ARM, given), "tensions", SHAPED) for what, given in WRONG.items()},
    **{
        f"{name} {value}": (
            partial(settle, ARM, tensions(index, value)),
            f"tensions[{index}] ({name})",
            NO_TENSION,
        )
        for index, name in ((0, "T_11"), (4, "T_21"), (11, "T_34"))
        for value in (-1e-9, -1.0, np.nan, np.inf, -np.inf)
    },
    "in rows": (
        lambda: settle(ARM, tensions(4, -1.0).reshape(3, 4)),
        "tensions[4] (T_21)",
        NO_TENSION,
    ),
    "a set of many": (
        lambda: settle_many(ARM, [np.zeros(12), np.zeros(12), tensions(5, -1.0)]),
        "tensions[2][5] (T_22)",
        NO_TENSION,
    ),
    "a short set of many": (
        lambda: settle_many(ARM, [np.zeros(12), np.zeros(11)]),
        "tensions[1]",
        "12 numbers",
    ),
    "errors by another word": (
        lambda: settle_many(ARM, [np.zeros(12)], errors="ignore"),  # type: ignore[arg-type]
        "errors",
        "",
    ),
    **{
        f"compiled by {how!r}": (
            partial(settle, ARM, np.zeros(12), compile=how),
            "compile",
            'True, False or "auto"',
        )
        for how in ("try", 1, None)
    },
}


@pytest.mark.parametrize(("attempt", "field", "allowed"), NOT_ALLOWED.values(), ids=NOT_ALLOWED)
def test_what_is_no_tension_is_refused_by_the_name_of_its_tendon(
    attempt: Callable[[], object], field: str, allowed: str
) -> None:
    check_refusal(attempt, field, allowed)


@pytest.mark.parametrize("scene", [PAPER, Scene.as_printed()], ids=["paper", "as_printed"])
def test_an_arm_is_not_crushed_unnoticed(scene: Scene) -> None:
    with pytest.raises(CollapsedError) as caught:
        settle(ARM, CRUSHING, scene)
    error = caught.value
    at = ARM.sections[2].at
    assert error.s == pytest.approx(at)
    assert error.stretch == pytest.approx(1 + strain(paper_rod("table-2"), CRUSHING, at, True)[3])
    assert error.stretch < 0
    assert f"s = {error.s:.6g} m" in str(error)
    assert settle(ARM, CRUSHING).error < 1e-6


def test_an_arm_just_short_of_crushing_settles() -> None:
    rod, at = paper_rod("table-2"), ARM.sections[2].at
    limit = CRUSHING / -strain(rod, CRUSHING, at, True)[3]
    assert settle(ARM, 0.999 * limit, PAPER).strain(at)[3] == pytest.approx(-0.999)
    with pytest.raises(CollapsedError):
        settle(ARM, 1.001 * limit, PAPER)


def test_a_crushed_set_among_many_is_named_as_a_collapse_as_it_is_alone() -> None:
    with pytest.raises(CollapsedError, match=r"tensions\[1\]"):
        settle_many(ARM, [np.zeros(12), CRUSHING], PAPER)


ERRORS_OF_OURS = [
    InputError("arm", "table-3", "table-2"),
    InputError("tensions", np.float64(-1.0), "0 or above"),
    CollapsedError(0.093, -0.5),
    ConvergenceError(1e-6, 1e-3, "ask for less"),
]


@pytest.mark.parametrize("error", ERRORS_OF_OURS, ids=lambda e: type(e).__name__)
def test_errors_travel_between_processes(error: OctoplanError) -> None:
    there = pickle.loads(pickle.dumps(error))
    assert type(there) is type(error)
    assert isinstance(there, OctoplanError)
    assert str(there) == str(error)
    assert vars(there) == vars(error)


@pytest.mark.parametrize("reached", [np.inf, np.nan])
def test_an_arm_of_which_no_error_is_known_is_not_settled(reached: float) -> None:
    """The arm was settled with an error of NaN."""
    assert str(ConvergenceError(1e-8, reached, "x")) == "the arm was not settled; x"


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (((2, 0, 0), (0, 1, 0), (0, 0, 1)), "column 0 has length 2"),
        (((1, 0, 0), (0, 1, 0.6), (0, 0, 0.8)), "columns 1 and 2 are not orthogonal"),
        (((1, 0, 0), (0, 1, 0), (0, 0, -1)), "det = -1"),
    ],
)
def test_a_wrong_frame_is_refused_with_the_reason(frame: Any, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        replace(Arm.from_paper("table-4"), base_frame=frame)
