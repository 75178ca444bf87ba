"""An arm that leans on things: complementarity, stiffness, stability, the way it came there."""

import pickle

import casadi as ca
import numpy as np
import pytest

from model import Arm, Scene, settle
from model.contact.forward import TouchingMap
from model.effects import (
    Contact,
    Effect,
    ExactTendons,
    Extension,
    NeoHookean,
    PrintedStatics,
    TipLoad,
    Weight,
)
from model.errors import ConvergenceError, InputError, UnsettledContactError
from model.least_energy import LeastEnergy
from model.obstacles import Box, Capsule, HalfSpace, Sphere
from model.stiffness import stiffness
from model.transcription.system import system

ARM = Arm.from_paper("table-4")
TENSIONS = np.array([[0, 0, 0.5, 0], [4, 0, 0, 0], [0, 3, 0, 0]])
ROD = Capsule((0.1, -0.05, -0.06), (0.1, 0.05, -0.06), 0.02)
SCENES = {
    "paper": Scene(Extension(), Contact(ROD)),
    "exact": Scene(Extension(), ExactTendons(), Contact(ROD)),
    "silicone": Scene(Extension(), ExactTendons(), NeoHookean(), Contact(ROD)),
}


def _gaps(shape, obstacle, swells: bool) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Return gaps along the arm, by NumPy alone from what is read off the shape."""
    s = np.linspace(0, ARM.length, 1501)
    radius = 0.015 + (0.002 - 0.015) * s / ARM.length
    if swells:
        radius = radius / np.sqrt(1 + shape.strain(s)[:, 3])
    a, b = np.array(obstacle.start), np.array(obstacle.end)
    x = shape.position(s)
    share = np.clip((x - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    near = a + share[:, None] * (b - a)
    return np.linalg.norm(x - near, axis=1) - obstacle.radius - radius


@pytest.mark.quick("exact")
@pytest.mark.parametrize("name", SCENES)
def test_gap_and_force_are_complementary(name: str) -> None:
    shape = settle(ARM, TENSIONS, SCENES[name])
    gaps = _gaps(shape, ROD, name == "silicone")
    assert gaps.min() > -1e-8
    assert gaps.min() < 1e-5
    assert shape.contacts
    for touch in shape.contacts:
        out = shape.position(touch.s) - touch.point
        assert abs(touch.gap) < 1e-12
        assert touch.force @ out > 0
        assert np.linalg.norm(np.cross(touch.force, out)) < 1e-12
        assert ROD.distance(touch.point) == pytest.approx(0, abs=1e-12)


def test_a_scene_whose_obstacles_are_far_off_is_one_without() -> None:
    far = Scene(Extension(), ExactTendons(), Contact(Sphere((3.0, 0, 0), 0.1)))
    alone = settle(ARM, TENSIONS, Scene(Extension(), ExactTendons()), 1e-8)
    shape = settle(ARM, TENSIONS, far, 1e-8)
    assert shape.tip == pytest.approx(alone.tip, abs=1e-8)
    assert shape.contacts == ()


def test_compliance_of_the_held_arm_is_the_derivative_of_where_it_settles() -> None:
    scene = SCENES["exact"]
    found = stiffness(ARM, TENSIONS, scene, accuracy=1e-7)
    own = found.compliance[:3, :3]
    assert own == pytest.approx(own.T, abs=1e-4)
    push, tips = 2e-4, []
    for sign in (1, -1):
        load = TipLoad(force=(0, 0, sign * push))
        tips.append(settle(ARM, TENSIONS, Scene(*scene.effects, load), 1e-9).tip)
    moved = (tips[0] - tips[1]) / (2 * push)
    assert found.compliance[:3, 2] == pytest.approx(moved, rel=1e-4, abs=1e-4)
    free = stiffness(ARM, TENSIONS, Scene(Extension(), ExactTendons()), accuracy=1e-7)
    assert np.trace(found.compliance[:3, :3]) < np.trace(free.compliance[:3, :3])


@pytest.mark.slow
def test_what_it_leans_on_may_be_many_and_of_all_kinds() -> None:
    bodies = [
        HalfSpace((0, 0, -0.09), (0, 0, 1)),
        Box((0.2, 0.1, 0.0), (0.1, 0.05, 0.2)),
        Sphere((0.16, -0.06, -0.05), 0.02),
    ]
    scene = Scene(Extension(), ExactTendons(), *(Contact(body) for body in bodies))
    shape = settle(ARM, TENSIONS, scene)
    s = np.linspace(0, ARM.length, 1501)
    radius = 0.015 + (0.002 - 0.015) * s / ARM.length
    for body in bodies:
        assert (body.distance(shape.position(s)) - radius).min() > -1e-8
    assert shape.contacts
    assert shape.stability > 0


def test_an_arm_that_begins_inside_is_refused() -> None:
    scene = Scene(Contact(Sphere((0.2, 0, 0.02), 0.03)))
    with pytest.raises(InputError, match=r"19\.2 mm inside at s = 0\.2"):
        settle(ARM, TENSIONS, scene)


def test_obstacles_between_which_nothing_fits_are_refused() -> None:
    above, below = HalfSpace((0, 0, 0.01), (0, 0, -1)), HalfSpace((0, 0, -0.01), (0, 0, 1))
    told = r"Contact\.obstacle: got HalfSpace.* inside at s = 0\.0.* mm inside of HalfSpace"
    with pytest.raises(InputError, match=told):
        settle(ARM, TENSIONS, Scene(Contact(above), Contact(below)))


def test_an_arm_lies_in_the_groove_between_two_obstacles() -> None:
    """Places at one arc length were no places: none was found, after 40 s."""
    arm, pull = Arm.from_paper("table-2"), np.eye(12)[1]
    balls = [Sphere((0.2, sign * 0.02, -0.06), 0.04) for sign in (1, -1)]
    scene = Scene(Extension(), ExactTendons(), *map(Contact, balls))
    first, second = settle(arm, pull, scene, 1e-6).contacts
    assert first.s == pytest.approx(second.s, abs=1e-9)
    assert first.force * [1, -1, 1] == pytest.approx(second.force, abs=1e-7)
    assert abs(first.force[1]) > 1e-3


def test_what_is_not_found_says_how_far_it_came(monkeypatch: pytest.MonkeyPatch) -> None:
    forward = TouchingMap(ARM, SCENES["exact"], 3, 1)
    monkeypatch.setattr(LeastEnergy, "least", lambda *_: None)
    monkeypatch.setattr("model.contact.path.newton", lambda *_, **__: None)
    told = r"at \d.* % of tensions and loads no least energy is found"
    with pytest.raises(UnsettledContactError, match=told) as caught:
        forward.solve(TENSIONS.ravel())
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.share) == (str(caught.value), caught.value.share)
    assert isinstance(again, ConvergenceError)


def test_what_is_no_contact_is_refused() -> None:
    with pytest.raises(InputError, match=r"Contact\.obstacle"):
        Contact(0.1)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"Contact\.friction"):
        Contact(ROD, friction=-0.1)
    with pytest.raises(InputError, match="a body once"):
        Scene(Contact(ROD), Contact(ROD))
    with pytest.raises(InputError, match="PrintedStatics"):
        Scene(Extension(), PrintedStatics(), Contact(ROD))
    with pytest.raises(InputError, match="lengths"):
        settle(ARM, lengths=np.full(12, 0.4), scene=Scene(Contact(ROD, friction=0.3)))


def test_a_scene_without_contact_costs_what_it_did_to_the_instruction() -> None:
    """Of values and Jacobians of its kernels, as counted before there was contact."""

    def instructions(function: ca.Function) -> int:
        """How many there are, what is computed twice counted once."""
        given = function.sx_in()
        return int(ca.Function("f", given, function.call(given), {"cse": True}).n_instructions())

    def kernels(*effects: Effect) -> dict[str, tuple[int, int]]:
        terms = system(ARM, Scene(Extension(), *effects), 3, 1).of.equations.terms
        found = {term.kernel.name: term.kernel for term in terms}
        return {
            name: (instructions(kernel.value), instructions(kernel.derivative("jacobian")[0]))
            for name, kernel in found.items()
        }

    load = TipLoad(force=(0, 0, -0.01))
    assert kernels(load) == {
        "clamp": (28, 8),
        "element": (1219, 10918),
        "tip": (22, 13),
        "body": (15, 7),
        "tendon": (38, 49),
    }
    assert kernels(ExactTendons(), NeoHookean(), Weight()) == {
        "clamp": (28, 8),
        "element": (1207, 10330),
        "tip": (22, 13),
        "body": (63, 148),
        "tendon": (71, 237),
    }
    assert {"touch", "no_touch"} <= kernels(load, Contact(ROD)).keys()
