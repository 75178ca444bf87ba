"""Loads of exported arms: MuJoCo simulates loads, other formats refuse or name loads."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from octoplan.model import Anchorage, Arm, InputError, Linear, OctoplanError, Scene, Shape, settle
from octoplan.model.effects import (
    Buoyancy,
    Current,
    ExactTendons,
    Extension,
    LineLoad,
    NeoHookean,
    PointLoad,
    PointMass,
    Shear,
    TipLoad,
    Weight,
)
from octoplan.model.effects.base import Effect
from octoplan.model.extensions.contact.effects import Contact, SelfContact
from octoplan.model.extensions.friction import Friction
from octoplan.model.extensions.obstacles import HalfSpace
from octoplan.planner import export
from octoplan.planner.frontends.bodies.forces import ExportWarning
from octoplan.planner.frontends.bodies.links import urdf
from octoplan.planner.frontends.bodies.mjcf import mjcf
from octoplan.planner.frontends.cli import main
from octoplan.planner.limits import natural_tensions
from tests.contact.cases import bar

mujoco = pytest.importorskip("mujoco")
quiet = pytest.mark.filterwarnings("ignore::octoplan.planner.frontends.bodies.forces.ExportWarning")

EXACT = (Extension(), ExactTendons())
STATICS = (EXACT, (*EXACT, NeoHookean()), (Extension(),), (*EXACT, Shear()))
WATER = (Weight(), Buoyancy())
PULLED = np.zeros((3, 4))
PULLED[0, 2], PULLED[1, 0] = 0.4, 1.2


def random_case(seed: int) -> tuple[Arm, Any, Scene]:
    """Return an arm in a random frame, tensions, and a scene with random loads in a fluid."""
    rng = np.random.default_rng(seed)
    arm = Arm.from_paper(("table-2", "table-4", "section-5.2")[seed % 3])
    frame = Rotation.random(random_state=seed).as_matrix()
    place = tuple(rng.uniform(-1, 1, 3))
    arm = replace(arm, base_frame=tuple(map(tuple, frame)), base_position=place)
    gravity = rng.normal(size=3)
    gravity *= 9.81 / np.linalg.norm(gravity)
    loads: list[Effect] = [Weight(tuple(gravity)), Buoyancy(float(rng.choice([1000.0, 1200.0])))]
    force, moment = 2e-3 * rng.normal(size=3), 2e-5 * rng.normal(size=3)
    loads.append(TipLoad(tuple(force), tuple(moment), follower=seed % 2 == 0))
    places = rng.uniform(0.2, 1.0, 2) * arm.length
    loads.append(PointLoad(places[0], tuple(2e-3 * rng.normal(size=3))))
    loads.append(PointMass(places[1], 2e-4, tuple(rng.uniform(-0.01, 0.01, 3))))
    if seed % 3 == 0:
        loads.append(Current(tuple(0.05 * rng.normal(size=3))))
    tensions = natural_tensions(arm) * rng.uniform(0.0, 1.0, arm.n_tendons)
    tensions *= rng.random(arm.n_tendons) < 0.5
    return arm, tensions, Scene(*STATICS[seed % 4], *loads)


def simulated(model: Any, seconds: float, controls: Any = None) -> tuple[Any, float]:
    """Return the data after a simulation from the keyframe, and the largest motion of a body [m].

    Places of bodies are compared every 20 ms.
    """
    data, start = mujoco.MjData(model), mujoco.MjData(model)
    for each in (data, start):
        mujoco.mj_resetDataKeyframe(model, each, 0)
        mujoco.mj_forward(model, each)
    if controls is not None:
        data.ctrl[:] = controls
    farthest = 0.0
    for _ in range(round(seconds / model.opt.timestep / 20)):
        mujoco.mj_step(model, data, 20)
        farthest = max(farthest, np.linalg.norm(data.xpos - start.xpos, axis=1).max())
    return data, float(farthest)


def tip_error(data: Any, shape: Shape) -> float:
    """Return the distance of MuJoCo's tip from a settled one, over the arm's length."""
    return float(np.linalg.norm(data.site("tip").xpos - shape.tip) / shape.arm.length)


@quiet
@pytest.mark.quick("0", "3", "4")
@pytest.mark.parametrize("seed", range(8))
def test_keyframe_stays_for_six_seconds_under_loads(
    seed: int, deviation: Callable[..., float]
) -> None:
    arm, tensions, scene = random_case(seed)
    shape = settle(arm, tensions, scene)
    model = mujoco.MjModel.from_xml_string(mjcf(shape, 10))
    data, farthest = simulated(model, 6.0)
    assert farthest < 1e-6 * arm.length
    assert deviation(tip_error(data, shape), 0.0) < 1e-6
    assert data.qfrc_gravcomp.any()


SINGLE = {
    "buoyancy": WATER,
    "point load": (*WATER, PointLoad(0.2, (0.0, 1e-2, -5e-3), (1e-5, -1e-4, 1e-4))),
    "line load": (LineLoad((0.0, 2e-2, -2e-2), (1e-4, -5e-4, 4e-4), 0.03, 0.25),),
    "following line": (LineLoad((0.0, 2e-2, -2e-2), (1e-4, -5e-4, 4e-4), 0.1, None, True),),
    "tip load": (TipLoad((0.0, 3e-3, -3e-3), (1e-5, -1e-4, 1e-4)),),
    "follower": (TipLoad((0.0, 3e-3, -3e-3), (1e-5, -1e-4, 1e-4), follower=True),),
    "point mass": (*WATER, PointMass(0.25, 2e-3, (0.0, 0.01, 0.0))),
    "upward gravity": (Weight((3.0, -4.0, 6.0)), Buoyancy(1050.0)),
    "heavy fluid": (Weight(), Buoyancy(1200.0)),
    "none": (),
}


@quiet
@pytest.mark.parametrize("loads", SINGLE.values(), ids=SINGLE)
def test_chain_follows_other_tensions_and_loads(loads: tuple[Effect, ...]) -> None:
    """Springs in place of a load would keep the arm in its loaded shape.

    A chain turns at nodes, so that anchorages inside of the arm are off by half a link: tendons to
    the tip pull.
    """
    arm, pulled = Arm.from_paper("table-2"), np.zeros((3, 4))
    pulled[0, 2] = 0.4
    shape = settle(arm, pulled, Scene(*EXACT, *loads))
    model = mujoco.MjModel.from_xml_string(mjcf(shape, 12))
    # Damping has no part in equilibria.
    model.dof_damping *= 4
    assert model.opt.gravity.any() == any(isinstance(load, Weight) for load in loads)
    half = settle(arm, pulled / 2, shape.scene)
    controls = np.ones(model.nu)
    controls[: arm.n_tendons] = pulled.ravel() / 2
    data, _ = simulated(model, 3.0, controls)
    moved = float(np.linalg.norm(half.tip - shape.tip) / arm.length)
    assert moved > 0.05
    assert tip_error(data, half) < 0.1 * moved
    switched = [each for each in loads if isinstance(each, PointLoad | TipLoad)]
    if switched:
        without = Scene(*(each for each in shape.scene.effects if each not in switched))
        free = settle(arm, pulled, without)
        controls = np.append(pulled.ravel(), np.zeros(len(switched)))
        data, _ = simulated(model, 3.0, controls)
        moved = float(np.linalg.norm(free.tip - shape.tip) / arm.length)
        assert moved > 0.02
        assert tip_error(data, free) < 0.1 * moved


@pytest.mark.parametrize("links", [1, 2, 7])
def test_few_links_keep_all_tendons_and_the_balance(links: int) -> None:
    """Tendons that end before the second node had no actuator, and springs no pull."""
    sections = (
        Anchorage(0.29, Linear(0.008, 0.004), (0.0, 2.1, 4.2)),
        Anchorage(0.1, Linear(0.007, 0.007)),
    )
    arm = Arm(0.3, Linear(0.012, 0.006), sections)
    shape = settle(arm, [0.2, 0, 0, 0, 0.3, 0, 0], Scene(*EXACT, *WATER))
    model = mujoco.MjModel.from_xml_string(mjcf(shape, links))
    assert model.nu == arm.n_tendons
    data, farthest = simulated(model, 1.0)
    assert farthest < 1e-6 * arm.length
    lengths = data.ten_length
    assert lengths == pytest.approx(shape.tendon_lengths, rel=0.1 if links == 1 else 0.02)


SCENE = """
tensions = [[0.0, 0.0, 0.1, 0.0], [0.3, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]
[arm]
preset = "table-2"
[effects]
extension = true
exact_tendons = true
weight = { g = [0.0, 0.0, -9.81] }
buoyancy = { density = 1000.0 }
point_loads = [{ s_mm = 200.0, force = [0.0, 0.01, -0.005] }]
"""


@pytest.mark.slow
def test_command_writes_a_keyframe_that_stays(tmp_path: Path) -> None:
    """The arm fell by 161 of 300 mm."""
    scene = tmp_path / "arm.toml"
    scene.write_text(SCENE)
    argv = ["export", str(scene), "--what", "mjcf", "--to", str(tmp_path), "--links", "12"]
    assert main(argv) == 0
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    assert simulated(model, 6.0)[1] < 1e-6 * 0.31


@pytest.mark.filterwarnings("always::octoplan.planner.frontends.bodies.forces.ExportWarning")
def test_command_names_loads_that_urdf_lacks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "arm.toml"
    scene.write_text(SCENE)
    argv = ["export", str(scene), "--what", "urdf", "--to", str(tmp_path), "--json"]
    assert main(argv) == 0
    shown = capsys.readouterr()
    sentence = "URDF has no loads: Buoyancy, PointLoad, Weight left out"
    assert sentence in shown.err
    assert sentence in (tmp_path / "arm.urdf").read_text()
    assert len(json.loads(shown.out)["files"]) == 2


@pytest.mark.slow
def test_current_and_obstacles_are_named_in_mjcf() -> None:
    floor = Contact(HalfSpace((0.0, 0.0, -0.5), (0.0, 0.0, 1.0)))
    shape = settle(Arm.from_paper("table-2"), PULLED, Scene(*EXACT, floor))
    with pytest.warns(ExportWarning, match="Contact left out of MJCF"):
        text = mjcf(shape, 3)
    assert "<!-- Contact left out of MJCF" in text
    stream = Scene(*EXACT, Current((0.0, 0.05, 0.0)))
    with pytest.warns(ExportWarning, match="Current is constant in MJCF"):
        mjcf(settle(Arm.from_paper("table-2"), PULLED, stream), 3)


FLOOR = Contact(HalfSpace((0.0, 0.0, -0.008), (0.0, 0.0, 1.0)))


def test_links_that_turn_too_far_are_named() -> None:
    arm, tensions = Arm.from_paper("table-2"), np.zeros(12)
    tensions[2] = 4 * natural_tensions(arm)[2]
    shape = settle(arm, tensions, Scene(*EXACT))
    with pytest.warns(ExportWarning, match="links turn by more than 120 deg"):
        mjcf(shape, 1)


REFUSED = {"friction": Friction(0.2), "contact": FLOOR}


@pytest.mark.quick("friction")
@pytest.mark.parametrize("effect", REFUSED.values(), ids=REFUSED)
def test_mjcf_refuses_loads_that_it_cannot_have(effect: Effect) -> None:
    arm = bar(0.3, 0.006, 2e5)
    shape = settle(arm, [0.0, 0.5, 0.0, 0.0], Scene(*EXACT, effect), 1e-3)
    with pytest.raises(InputError, match="a scene with loads that MJCF supports") as caught:
        mjcf(shape, 3)
    assert caught.value.field == "scene"


@quiet
def test_urdf_has_point_masses_as_links() -> None:
    arm = Arm.from_paper("table-2")
    plain = settle(arm, PULLED, Scene(*EXACT, Weight()))
    loaded = settle(arm, PULLED, plain.scene + PointMass(0.2, 2e-3, (0.0, 0.01, 0.0)))
    roots = [ET.fromstring(urdf(shape, 5)) for shape in (plain, loaded)]
    masses = [sum(float(own.attrib["value"]) for own in root.iter("mass")) for root in roots]
    assert masses[1] - masses[0] == pytest.approx(2e-3)
    assert roots[1].find("joint[@name='mass_0']").attrib["type"] == "fixed"  # type: ignore[union-attr]


LOADED = (
    Contact(HalfSpace((0.0, 0.0, -0.5), (0.0, 0.0, 1.0))),
    Current((0.0, 0.05, 0.0)),
    Friction(0.2),
    PointLoad(0.1, (0.0, 0.0, 0.0)),
    SelfContact(),
    Shear(),
    TipLoad(),
    Weight(),
)


@pytest.mark.parametrize("effect", LOADED, ids=lambda effect: type(effect).__name__)
def test_c_code_refuses_each_load(effect: Effect, tmp_path: Path) -> None:
    with pytest.raises(OctoplanError):
        export(Arm.from_paper("table-2"), Scene(*EXACT, effect), tmp_path, PULLED)
    assert list(tmp_path.iterdir()) == []
