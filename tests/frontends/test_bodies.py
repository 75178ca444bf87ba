"""Settled arms for other programs: meshes that close, chains that follow the arm."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from octoplan.model import Anchorage, Arm, InputError, Linear, Material, Scene, Shape, settle
from octoplan.model.effects import Buoyancy, Extension, NeoHookean, Weight
from octoplan.model.extensions.cross_sections import Rectangle
from octoplan.planner.frontends.bodies.files import export_shape, save_mesh
from octoplan.planner.frontends.bodies.links import ros_messages, urdf
from octoplan.planner.frontends.bodies.mjcf import mjcf
from octoplan.planner.frontends.c_code.export import export_plan
from octoplan.planner.frontends.cli import main
from octoplan.planner.frontends.io.csv_files import save_shape

pytestmark = pytest.mark.filterwarnings(
    "ignore::octoplan.planner.frontends.bodies.forces.ExportWarning"
)

PAPER = Scene(Extension())
TURNED = Rotation.from_rotvec([0.3, -1.2, 0.5]).as_matrix()
T = np.array([[0, 0, 0.3, 0], [1.0, 0, 0, 0.2], [0, 2.0, 0, 0]])
THREE = Arm(
    0.3,
    Linear(0.012, 0.006),
    (Anchorage(0.29, Linear(0.008, 0.004), (0.0, 2.1, 4.2)), Anchorage(0.1, Linear(0.007, 0.007))),
    base_frame=tuple(map(tuple, TURNED)),
    base_position=(0.1, -0.2, 0.3),
)


def shapes() -> dict[str, Shape]:
    arm = Arm.from_paper("table-4")
    moved = replace(arm, base_frame=tuple(map(tuple, TURNED)), base_position=(0.1, 0.2, -0.3))
    return {
        "paper": settle(arm, T, PAPER),
        "in water": settle(moved, T, Scene.silicone(Weight(), Buoyancy())),
        "other": settle(THREE, [0.5, 0, 0, 0, 1.0, 0, 0], PAPER),
        "rest": settle(arm, np.zeros(12), PAPER),
    }


SHAPES = shapes()
each_shape = pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)


@each_shape
@pytest.mark.parametrize("links", [1, 7, 30])
def test_mujoco_finds_the_arm_at_the_keyframe(shape: Shape, links: int) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(mjcf(shape, links))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    tip = data.site("tip")
    assert tip.xpos == pytest.approx(shape.tip, abs=1e-9)
    assert tip.xmat.reshape(3, 3) == pytest.approx(shape.tip_frame, abs=1e-9)
    s = np.linspace(0.0, shape.arm.length, links + 1)[:-1]
    nodes = [data.body(f"link_{i}").xpos for i in range(links)]
    assert np.array(nodes) == pytest.approx(shape.position(s), abs=1e-9)
    assert sum(model.body_mass) == pytest.approx(_mass(shape.arm), rel=0.2 if links == 1 else 0.01)


def _mass(arm: Arm) -> float:
    s = np.linspace(0, arm.length, 2001)
    radius = arm.radius.evaluate(s, arm.length)[0]
    return float(arm.material.density * np.pi * np.trapezoid(radius**2, s))


def _placed(text: str, joints: dict[str, float]) -> dict[str, Any]:
    """Return the pose (R, p) of each link of a URDF, by its XML alone."""
    root, poses = ET.fromstring(text), {"base_link": (np.eye(3), np.zeros(3))}
    for joint in root.iter("joint"):
        R, p = poses[joint.find("parent").attrib["link"]]  # type: ignore[union-attr]
        origin = joint.find("origin").attrib  # type: ignore[union-attr]
        xyz, rpy = (np.array([float(x) for x in origin[key].split()]) for key in ("xyz", "rpy"))
        axis = np.array([float(x) for x in joint.find("axis").attrib["xyz"].split()])  # type: ignore[union-attr]
        q = joints[joint.attrib["name"]]
        p, R = p + R @ xyz, R @ Rotation.from_euler("xyz", rpy).as_matrix()
        if joint.attrib["type"] == "prismatic":
            p = p + R @ (q * axis)
        else:
            R = R @ Rotation.from_rotvec(q * axis).as_matrix()
        poses[joint.find("child").attrib["link"]] = R, p  # type: ignore[union-attr]
    return poses


@each_shape
def test_a_urdf_with_its_joint_state_is_the_arm(shape: Shape) -> None:
    links = 12
    text, messages = urdf(shape, links), ros_messages(shape, links)
    chain = messages["chain"]
    poses = _placed(text, dict(zip(chain["name"], chain["position"], strict=True)))
    base, origin = np.array(shape.arm.base_frame), np.array(shape.arm.base_position)
    for i, s in enumerate(np.linspace(0.0, shape.arm.length, links + 1)):
        R, p = poses[f"link_z_{i}"]
        assert origin + base @ p == pytest.approx(shape.position(s), abs=1e-9)
    assert base @ R == pytest.approx(shape.tip_frame, abs=1e-9)
    named = [own.attrib["name"] for own in ET.fromstring(text) if own.tag == "link"]
    assert len({*named}) == len(named) == 1 + 4 * (links + 1) - 1
    masses = [float(own.attrib["value"]) for own in ET.fromstring(text).iter("mass")]
    assert sum(masses) == pytest.approx(_mass(shape.arm), rel=0.01)
    turned = next(own.attrib for own in ET.fromstring(text).iter("inertia"))
    solid = next(own.attrib for own in ET.fromstring(text).iter("cylinder"))
    about, r = float(turned["izz"]) / masses[0], float(solid["radius"])
    assert about == pytest.approx(r**2 / 2)
    assert float(turned["ixx"]) / masses[0] == pytest.approx(
        (3 * r**2 + float(solid["length"]) ** 2) / 12
    )


@each_shape
def test_messages_hold_tendons_and_the_midline(shape: Shape) -> None:
    messages = json.loads(json.dumps(ros_messages(shape)))
    tendons = messages["tendons"]
    assert tendons["effort"] == pytest.approx(shape.tensions)
    assert tendons["name"][0] == "T_11"
    base, origin = np.array(shape.arm.base_frame), np.array(shape.arm.base_position)
    last = messages["path"]["poses"][-1]["pose"]
    place = np.array([last["position"][axis] for axis in "xyz"])
    assert origin + base @ place == pytest.approx(shape.tip, abs=1e-9)
    q = [last["orientation"][axis] for axis in "xyzw"]
    assert base @ Rotation.from_quat(q).as_matrix() == pytest.approx(shape.tip_frame, abs=1e-9)


@each_shape
@pytest.mark.parametrize("suffix", [".stl", ".glb", ".ply", ".obj"])
def test_meshes_close_and_have_the_body_s_volume(shape: Shape, suffix: str, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.load(save_mesh(shape, tmp_path / f"arm{suffix}"), force="mesh")
    assert mesh.is_watertight
    assert mesh.volume > 0
    # By Pappus, the volume of a tube is the integral of its sections along the deformed midline.
    s = np.linspace(0.0, shape.arm.length, 401)
    path = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(shape.position(s), axis=0), axis=1)))
    area = np.pi * shape.arm.radius.evaluate(s, shape.arm.length)[0] ** 2
    # A neo-Hookean body keeps its volume at rest.
    along = s if shape.scene.has(NeoHookean) else path
    assert mesh.volume == pytest.approx(np.trapezoid(area, along), rel=0.01)
    near = np.linalg.norm(mesh.vertices - shape.tip, axis=1).min()
    assert near < 1e-6


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda shape: mjcf(shape, 0), "links"),
        (lambda shape: urdf(shape, 5000), "links"),
        (lambda shape: save_mesh(shape, "arm.step"), "path"),
        (lambda shape: save_mesh(shape, "arm.stl", around=2), "around"),
        (lambda shape: mjcf(shape, 2, 3), "name"),  # type: ignore[arg-type]
        (lambda shape: urdf(shape, 2, None), "name"),  # type: ignore[arg-type]
    ],
)
def test_bad_input_is_named(call: Any, field: str) -> None:
    with pytest.raises(InputError) as caught:
        call(SHAPES["rest"])
    assert caught.value.field == field


@pytest.mark.parametrize("given", [None, "arm", SHAPES, [1.0], Shape])
def test_what_is_no_shape_is_named(given: Any, tmp_path: Path) -> None:
    for call in (
        lambda: mjcf(given),
        lambda: urdf(given),
        lambda: ros_messages(given),
        lambda: save_mesh(given, tmp_path / "arm.stl"),
        lambda: save_shape(given, tmp_path / "arm.csv"),
        lambda: export_shape(given, tmp_path, "mesh"),
    ):
        with pytest.raises(InputError) as caught:
            call()
        assert caught.value.field == "shape"
    with pytest.raises(InputError, match="p = "):
        export_plan(given, tmp_path)
    assert list(tmp_path.iterdir()) == []


SCENE = """
accuracy = 1e-4
{what}
[arm]
preset = "section-5.2"
[effects]
extension = true
"""
HELD = "tensions = [[0.3, 0.2, 0.0, 0.1]]"
TARGET = (
    '[target]\ntype = "bending-plane"\nangle_deg = 20\nbend_deg = 30\n[limits]\ntension_max = 5'
)


@pytest.mark.parametrize(
    ("what", "files"),
    [
        ("mesh", {"my_arm.stl", "my_arm.glb"}),
        ("mjcf", {"my_arm.xml"}),
        ("urdf", {"my_arm.urdf", "my_arm.ros.json"}),
    ],
)
@pytest.mark.parametrize("by", ["tensions", "target"])
def test_the_command_writes_them(
    what: str, files: set[str], by: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, to = tmp_path / "my-arm.toml", tmp_path / "out"
    text = SCENE.format(what=HELD) if by == "tensions" else SCENE.format(what="") + TARGET
    scene.write_text(text)
    argv = ["export", str(scene), "--what", what, "--to", str(to), "--links", "8", "--json"]
    assert main(argv) == 0
    shown = json.loads(capsys.readouterr().out)
    assert {Path(file).name for file in shown["files"]} == files
    assert {file.name for file in to.iterdir()} == files
    scene.write_text(SCENE.format(what=""))
    assert main(argv) == 2
    assert "tensions: missing" in capsys.readouterr().err


def test_links_of_a_strip_have_the_inertia_of_boxes() -> None:
    """MuJoCo computes the moments of inertia of a box of the same size and mass."""
    mujoco = pytest.importorskip("mujoco")
    width, height, length, links = 0.012, 0.002, 0.2, 4
    strip = Rectangle(Linear(width, width), Linear(height, height))
    section = Anchorage(length, Linear(0.0, 0.0), (0.0,))
    steel = Material(E=2e11, nu=0.3, density=7800.0)
    arm = Arm(length, strip.circumscribed(), (section,), steel, cross_section=strip)
    shape = settle(arm, [0.0], Scene())
    model = mujoco.MjModel.from_xml_string(mjcf(shape, links))
    size = f"{length / links / 2} {width / 2} {height / 2}"
    geom = f'<geom type="box" size="{size}" density="7800"/>'
    box = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><body>{geom}</body></worldbody></mujoco>"
    )
    link = model.body("link_0").id
    assert model.body_mass[link] == pytest.approx(box.body_mass[1], rel=1e-9)
    assert model.body_ipos[link] == pytest.approx([length / links / 2, 0, 0])
    # The order of principal axes is not that of the link.
    found, wanted = sorted(model.body_inertia[link]), sorted(box.body_inertia[1])
    assert found == pytest.approx(wanted, rel=1e-9)
    inertia = next(ET.fromstring(urdf(shape, links)).iter("inertia")).attrib
    told = [float(inertia[key]) for key in ("izz", "iyy", "ixx")]
    assert told == pytest.approx(box.body_inertia[1], rel=1e-6)
