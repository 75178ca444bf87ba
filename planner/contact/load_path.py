"""The load path by which an arm came into contact: which of several equilibria it is in."""

from __future__ import annotations

from model.arm import Arm
from model.errors import InputError
from model.loads import contacts, without_friction
from model.paths import Array
from model.scene import Scene
from model.settle import settle
from model.shape import Shape

# Tensions on the path to an equilibrium, in order.
LoadPath = tuple[tuple[float, ...], ...]
# How accurately shapes on the path are settled.
ON_THE_PATH = 1e-4


def rubs(scene: Scene) -> bool:
    """Return whether contacts of a scene have friction."""
    return any(contact.friction for contact in contacts(scene))


def is_same(near: Scene, scene: Scene) -> bool:
    """Return whether scenes are one; where contacts have friction, but for what they had before."""
    return near == scene or (rubs(scene) and without_friction(near) == without_friction(scene))


def from_rest(arm: Arm, tensions: Array, scene: Scene, name: str = "near") -> LoadPath:
    """Return the load path of an arm that touches nothing under tensions (n_tendons,).

    That is all that friction has to know of the motion before. Raises InputError, that names the
    field, where the arm touches something.
    """
    if settle(arm, tensions, without_friction(scene), ON_THE_PATH).contacts:
        allowed = (
            "the plan that the arm moves from: friction of contacts acts against the motion "
            "before, and an arm that touches something has no history by itself"
        )
        raise InputError(name, None, allowed)
    return (tuple(tensions.tolist()),)


def settled_along(
    arm: Arm,
    load_path: LoadPath,
    tensions: Array,
    scene: Scene,
    accuracy: float,
    machine_code: bool = False,
) -> Shape:
    """Return the shape that an arm comes to by tensions (n_tendons,) on its load path.

    From rest to the first of them tensions and loads grow in proportion, then tensions change in
    straight lines from one to the next. Where the arm jumps `Shape.snaps` of the last tells so.
    Friction of contacts acts beyond the first of them. Raises what settle does.
    """
    if not load_path and not rubs(scene):
        return settle(arm, tensions, scene, accuracy, compile=machine_code)
    rough = min(ON_THE_PATH, accuracy) if rubs(scene) else ON_THE_PATH
    first, *others = load_path or (tensions,)
    near = settle(arm, first, without_friction(scene), rough, compile=machine_code)
    for T in others:
        near = settle(arm, T, scene, rough, compile=machine_code, near=near)
    return settle(arm, tensions, scene, accuracy, compile=machine_code, near=near)
