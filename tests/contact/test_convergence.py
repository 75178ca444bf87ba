"""Where contact begins and ends, and how hard it presses there, on finer and finer meshes."""

import numpy as np

from model import Scene
from model.contact.contacts import touches_of
from model.contact.forward import TouchingMap
from model.effects import Contact, TipLoad
from model.obstacles import Capsule
from tests.contact.cases import bar


def test_ends_and_end_force_of_a_strip_on_a_cylinder_converge_with_order_four_or_more() -> None:
    cylinder = Capsule((0.12, -0.1, -0.064), (0.12, 0.1, -0.064), 0.06)
    scene, arm = Scene(TipLoad(force=(0, 0, -12.0)), Contact(cylinder)), bar(0.3, 0.002, 1e9)
    found, known = [], None
    for refinement in (1, 2, 4):
        forward = TouchingMap(arm, scene, 3, refinement)
        here = known = forward.found(np.zeros(4), known)
        first, second, *_, last = touches_of(here)
        spread = (second.s - first.s) * (2 * first.pressure + second.pressure) / 6
        found.append([first.s, last.s, np.linalg.norm(first.force) - spread])
    coarse, fine = (np.abs(np.array(one) - np.array(found[-1])) for one in found[:2])
    assert (np.log2(coarse / fine) > 4).all()
