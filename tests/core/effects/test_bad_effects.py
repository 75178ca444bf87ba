"""Invalid or contradictory effects, paths and curvatures are refused by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import permutations
from typing import Any

import numpy as np
import pytest

from octoplan.model import Anchorage, Arm, Linear, RestCurvature, Sampled, Scene, settle
from octoplan.model import settle_many as many
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    NeoHookean,
    PointLoad,
    PointMass,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.friction import Friction
from octoplan.model.extensions.printed import PrintedStatics
from octoplan.planner import plan, switch_effects
from octoplan.planner.targets import TipPosition
from tests.refusals import Refused, check_refusal

ARM = Arm.from_paper("table-4")
PAPER, REST = Scene(Extension()), np.zeros(12)
BENT = np.ravel([[0, 0.05, 0, 0], [0, 0, 0.8, 0.3], [1.5, 0, 0, 0]])
INF, NAN = np.inf, np.nan
FORCE = (0.0, 0.0, -1e-3)
TIP = TipPosition((0.2, 0.05, 0.0))

NUMBERS: dict[str, tuple[Callable[[Any], Effect], str]] = {
    "Buoyancy.density": (Buoyancy, "a number >= 0"),
    "Current.density": (lambda x: Current(FORCE, density=x), "a number >= 0"),
    "Current.coefficient": (lambda x: Current(FORCE, coefficient=x), "a number >= 0"),
    "Friction.mu": (Friction, "a number >= 0"),
    "PointLoad.s": (lambda x: PointLoad(x, FORCE), "a number >= 0"),
    "PointMass.mass": (lambda x: PointMass(0.1, x), "a number >= 0"),
    "Shear.k_s": (Shear, "above 0"),
}
NO_NUMBERS = {
    "NaN": (NAN, "finite"),
    "infinite": (INF, "finite"),
    "a string": ("0.1", "a number"),
    "nothing": (None, "a number"),
    "a truth": (True, "a number"),
    "two numbers": ((0.1, 0.2), "a number"),
}
VECTORS: dict[str, Callable[[Any], Effect]] = {
    "Weight.g": Weight,
    "Current.velocity": Current,
    "PointLoad.force": lambda x: PointLoad(0.2, x),
    "TipLoad.force": lambda x: TipLoad(force=x),
    "TipLoad.moment": lambda x: TipLoad(moment=x),
}
NO_VECTORS: dict[str, tuple[Any, str]] = {
    "a number": (1.0, "3 numbers"),
    "two numbers": ((1.0, 2.0), "3 numbers"),
    "four numbers": ((1.0, 2.0, 3.0, 4.0), "3 numbers"),
    "a column": (((1.0,), (2.0,), (3.0,)), "3 numbers"),
    "ragged": ((1.0, (2.0,), 3.0), "3 numbers"),
    "a string": ("down", "3 numbers"),
    "strings": (("0", "0", "1"), "3 numbers"),
    "nothing": (None, "3 numbers"),
    "truths": ((True, False, True), "3 numbers"),
    "complex": ((0, 0, 1j), "3 numbers"),
    "NaN": ((0.0, NAN, 0.0), "finite"),
    "infinite": ((0.0, 0.0, -INF), "finite"),
    "out of this world": ((0.0, 0.0, 1e31), "to 1e+30"),
}
IN_OR_OUT = "1 (pulling in) or -1 (paying out)"
DIRECTIONS: list[tuple[Any, str]] = [
    *((x, IN_OR_OUT) for x in (0, 2, (1, 0), (), (1, 0.5))),
    *((x, IN_OR_OUT) for x in ((1, NAN), 1.0, ((1,), (-1,)), "in", True)),
]
VALUES: Refused = {
    **{f"{f}, below 0": (partial(make, -1e-9), f, told) for f, (make, told) in NUMBERS.items()},
    **{
        f"{field}, {what}": (partial(make, x), field, told)
        for field, (make, _) in NUMBERS.items()
        for what, (x, told) in NO_NUMBERS.items()
    },
    **{
        f"{field}, {what}": (partial(make, x), field, told)
        for field, make in VECTORS.items()
        for what, (x, told) in NO_VECTORS.items()
    },
    **{
        f"follower {x}": (partial(TipLoad, FORCE, follower=x), "TipLoad.follower", "True or False")
        for x in ("yes", 1, 0.0, None, (True,))
    },
    **{
        f"anticlastic {x}": (partial(NeoHookean, x), "NeoHookean.anticlastic", "True or False")
        for x in ("no", 2, None, [True])
    },
    **{f"way {x}": (partial(Friction, 0.1, x), "Friction.direction", t) for x, t in DIRECTIONS},
    "no shear stiffness": (lambda: Shear(0.0), "Shear.k_s", "above 0"),
}
AN_EFFECT, ONCE = "an effect such as Extension()", "each effect once"
SCENES: Refused = {
    "an effect by name": (lambda: Scene("Weight"), "Scene effect 1", AN_EFFECT),  # type: ignore[arg-type]
    "a class": (lambda: Scene(Extension(), Weight), "Scene effect 2", AN_EFFECT),  # type: ignore[arg-type]
    "a list of effects": (lambda: Scene([Extension()]), "Scene effect 1", AN_EFFECT),  # type: ignore[arg-type]
    "a scene": (lambda: Scene(Scene()), "Scene effect 1", AN_EFFECT),  # type: ignore[arg-type]
    "nothing": (lambda: Scene(None), "Scene effect 1", AN_EFFECT),  # type: ignore[arg-type]
    "a number added": (lambda: PAPER + 9.81, "Scene effect 2", "an effect"),  # type: ignore[operator]
    "one given twice": (lambda: Scene(Weight(), Weight()), "Scene", ONCE),
    "one added again": (lambda: Scene(Weight()) + Weight((0.0, 0.0, -1.6)), "Scene", ONCE),
    "two of a kind": (lambda: Scene(TipLoad(FORCE), TipLoad()), "Scene", ONCE),
    "two currents": (lambda: Scene(Current(FORCE), Current(FORCE, 1.2)), "Scene", ONCE),
    "one switched on again": (
        lambda: PAPER + Extension(),
        "Scene",
        ONCE,
    ),
    "two loads at a place": (
        lambda: Scene(PointLoad(0.2, FORCE), PointLoad(0.1, FORCE), PointLoad(0.2, (1, 0, 0))),
        "Scene",
        "loads and masses: once at a place",
    ),
    "two masses at a place": (
        lambda: Scene(Weight(), PointMass(0.1, 0.01), PointMass(0.1, 0.02)),
        "Scene",
        "once at a place",
    ),
    "a mass without weight": (
        lambda: Scene(PointMass(0.1, 0.01)),
        "Scene",
        "PointMass with Weight",
    ),
    "buoyancy of what weighs nothing": (
        lambda: Scene(Extension(), Buoyancy()),
        "Scene",
        "Buoyancy with Weight: it is a weight",
    ),
    "buoyancy switched on alone": (
        lambda: PAPER + Buoyancy(),
        "Scene",
        "Buoyancy with Weight",
    ),
    "rubber on a bending arm": (lambda: Scene(NeoHookean()), "Scene", "NeoHookean with Extension"),
    "rubber on the paper's tendons": (
        lambda: Scene(NeoHookean(), Extension(), Weight()),
        "Scene",
        "NeoHookean with ExactTendons",
    ),
}
ASKED: dict[str, Callable[[Scene], object]] = {
    "settle": lambda scene: settle(ARM, REST, scene),
    "settle_many": lambda scene: many(ARM, np.zeros((2, 12)), scene),
    "switch_effects": lambda scene: switch_effects(ARM, REST, scene),
    "plan": lambda scene: plan(ARM, TIP, scene, 20.0),
}
OFF = {
    "a load off the arm": (Scene(PointLoad(0.45 + 1e-6, FORCE)), "PointLoad.s", "0.45 m"),
    "a mass off the arm": (Scene(Weight(), PointMass(0.5, 0.01)), "PointMass.s", "0.45 m"),
    "ways of another arm": (
        Scene(Friction(0.1, (1, -1, 1))),
        "Friction.direction",
        "one for each of 12 tendons",
    ),
}
PLACES: Refused = {
    f"{what}, {name}": (partial(ask, scene), field, told)
    for name, ask in ASKED.items()
    for what, (scene, field, told) in OFF.items()
}
SAMPLES = Sampled((0.0, 0.1, 0.2, 0.3), (0.0, 1.0, 2.0, 1.0))
BODY, Y, TURN = Linear(0.01, 0.01), Linear(6e-3, 6e-3), Linear(0.0, 1.1)
TURNING = Arm(0.2, BODY, (Anchorage(0.2, Y, (0.4, 2.0), TURN),))
CURVED = replace(ARM, rest_curvature=RestCurvature(Linear(1.0, -2.0)))
ARMS: Refused = {
    "printed, curved at rest": (
        lambda: settle(CURVED, REST, Scene.as_printed()),
        "Arm.rest_curvature",
        "straight at rest",
    ),
    "a path for a curvature": (lambda: replace(ARM, rest_curvature=BODY), "", "RestCurvature"),
    "a number for a curvature": (lambda: RestCurvature(3.0), "RestCurvature.n", ""),  # type: ignore[arg-type]
    "samples that end early": (
        lambda: replace(ARM, rest_curvature=RestCurvature(SAMPLES)),
        "Arm.rest_curvature.n.s",
        "samples from 0 to 0.45",
    ),
    "paths of three": (
        lambda: Anchorage(0.2, (Y,) * 3, (0.0, 1.0)),
        "Anchorage.offset",
        "2 paths, one for each tendon",
    ),
    "a number for a turn": (
        lambda: Anchorage(0.2, Y, (0.0, 1.0), (TURN, 3.0)),  # type: ignore[arg-type]
        "Anchorage.turn[1]",
        "",
    ),
    "a path beyond the body": (
        lambda: Arm(0.2, BODY, (Anchorage(0.2, (Y, Linear(6e-3, 0.02)), (0.0, 1.0)),)),
        "Arm.sections[0].offset",
        "",
    ),
    "turns as printed": (
        lambda: settle(TURNING, [1.0, 0.0], Scene.as_printed()),
        "Anchorage.turn",
        "constant angles",
    ),
    "an ablation to nothing": (lambda: switch_effects(ARM, BENT, PAPER, 0.0), "accuracy", ""),
    "an ablation of two": (lambda: switch_effects(ARM, [1.0, 2.0], PAPER), "tensions", ""),
}
WITHOUT_LOADS = "eqs. (10) and (11) are written without loads or shear"
NOT_PRINTED: dict[str, tuple[tuple[Effect, ...], str]] = {
    "tip load": ((TipLoad(FORCE),), WITHOUT_LOADS),
    "point load": ((PointLoad(0.1, FORCE),), WITHOUT_LOADS),
    "weight": ((Weight(),), WITHOUT_LOADS),
    "weight in water": ((Weight(), Buoyancy()), WITHOUT_LOADS),
    "current": ((Current(FORCE),), WITHOUT_LOADS),
    "shear": ((Shear(),), WITHOUT_LOADS),
    "friction": ((Friction(0.1),), "tensions that do not vary along a tendon"),
    "exact tendons": ((ExactTendons(),), "the reference tangent"),
    "rubber": ((ExactTendons(), NeoHookean()), "eqs. (10) and (11) are written for"),
}
PRINTED: Refused = {
    f"{name}, order {i}": (partial(Scene, *order), "Scene", reason)
    for name, (effects, reason) in NOT_PRINTED.items()
    for i, order in enumerate(permutations((Extension(), PrintedStatics(), *effects)))
}
REFUSED = VALUES | SCENES | PLACES | ARMS | PRINTED


@pytest.mark.parametrize(("attempt", "field", "allowed"), REFUSED.values(), ids=REFUSED)
def test_what_is_no_effect_or_goes_with_none_is_refused(
    attempt: Callable[[], object], field: str, allowed: str
) -> None:
    check_refusal(attempt, field, allowed)


def test_zero_is_allowed_but_for_the_stiffness_in_shear() -> None:
    assert all(make(0) == make(0.0) for field, (make, _) in NUMBERS.items() if field != "Shear.k_s")


def test_loads_at_different_places_and_masses_of_different_offsets_are_fine() -> None:
    loads = (PointLoad(0.1, FORCE), PointLoad(0.2, FORCE))
    assert settle(ARM, BENT, Scene(*loads), 1e-4).error <= 1e-4
    both = PointMass(0.1, 0.01, (0.0, 0.01, 0.0)), PointMass(0.1, 0.01)
    assert len(Scene(Weight(), *both).effects) == 3


@pytest.mark.parametrize("apart", [5e-17, 1e-12, 1e-10, 1e-8], ids=str)
@pytest.mark.parametrize("at", [0.3, 0.315, 0.45 - 2e-8], ids=["between", "anchorage", "tip"])
def test_point_loads_that_all_but_coincide_are_felt_together(at: float, apart: float) -> None:
    near = float(max(np.nextafter(at, 1), at + apart))
    two = settle(ARM, BENT, Scene(PointLoad(at, FORCE), PointLoad(near, FORCE)), 1e-8)
    one = settle(ARM, BENT, Scene(PointLoad(at, tuple(2 * np.array(FORCE)))), 1e-8)
    assert np.linalg.norm(two.tip - one.tip) < (1e-8 + apart) * ARM.length
