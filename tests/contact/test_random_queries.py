"""Random arms pulled against random obstacles are in balance; meshes converge."""

from collections import Counter

import numpy as np
import pytest

from octoplan.model import OctoplanError, Scene, settle
from octoplan.model.effects import TipLoad
from octoplan.model.extensions.contact.effects import Contact
from octoplan.model.extensions.contact.forward import TouchingMap
from octoplan.model.extensions.contact.touches import equilibrium_contacts
from octoplan.model.extensions.obstacles import Capsule
from tests.contact.cases import bar
from tests.contact.queries import complementarity, imbalance, query
from tests.lengths.cases import check_complementary


def ending(seed: int) -> str:
    """Return the verdict on a query; "wrong" for a shape that is no equilibrium with contact."""
    asked = query(seed)
    try:
        shape = settle(asked.arm, asked.tensions, asked.scene, 1e-4)
    except OctoplanError as problem:
        return type(problem).__name__
    if complementarity(asked, shape) > 1e-8 or imbalance(asked, shape) > 1e-3:
        return "wrong"
    return "touches" if shape.contacts else "free"


@pytest.mark.quick("a gap that dips below 0 between two looks")
@pytest.mark.parametrize(
    "seed",
    [
        pytest.param(2, id="what is known of an element looks as if it passed through"),
        pytest.param(3, id="a sphere, a box"),
        pytest.param(24, id="it slides over an edge"),
        pytest.param(33, id="curvatures jump at an edge"),
        pytest.param(37, id="two places next to an anchorage"),
        pytest.param(134, id="a mesh with more nodes than it began with"),
        pytest.param(75, id="heavy silicone, three obstacles"),
        pytest.param(256, id="a part that ends at an edge"),
        pytest.param(368, id="a gap that dips below 0 between two looks"),
        pytest.param(498, id="the tip and a place just before it"),
        pytest.param(30021, id="what catches at a node slides on"),
        pytest.param(811013, id="a part that grows slowly until it meets a point"),
        pytest.param(994107, id="a straight tip lies along a plane, beyond the point that presses"),
    ],
)
def test_a_query_is_settled(seed: int) -> None:
    assert ending(seed) in ("touches", "free")


# Equilibria that followed each other closely in long steps changed to the other side.
@pytest.mark.slow
@pytest.mark.parametrize("seed", [42030, 42067, 43030, 43124])
def test_the_arm_comes_to_the_side_of_an_obstacle_that_short_steps_lead_to(seed: int) -> None:
    asked, near = query(seed), None
    shape = settle(asked.arm, asked.tensions, asked.scene, 1e-4)
    for part in np.linspace(0, 1, 25)[1:]:
        near = settle(asked.arm, part * asked.tensions, asked.scene, 1e-4, near=near)
    assert near is not None and shape.contacts
    assert np.linalg.norm(shape.tip - near.tip) <= 1e-6 * asked.arm.length


@pytest.mark.slow
def test_of_525_random_queries_98_percent_are_settled_and_none_is_wrong() -> None:
    ends = Counter(ending(seed) for seed in range(525))
    assert not ends["wrong"], ends
    assert ends["touches"] + ends["free"] >= 0.98 * ends.total(), ends
    assert ends["touches"] >= 0.8 * ends.total(), ends


def test_ends_and_end_force_of_a_strip_on_a_cylinder_converge_with_order_four_or_more() -> None:
    cylinder = Capsule((0.12, -0.1, -0.064), (0.12, 0.1, -0.064), 0.06)
    scene, arm = Scene(TipLoad(force=(0, 0, -12.0)), Contact(cylinder)), bar(0.3, 0.002, 1e9)
    found, known = [], None
    for refinement in (1, 2, 4):
        forward = TouchingMap(arm, scene, refinement)
        here = known = forward.solve(np.zeros(4), known)
        first, second, *_, last = equilibrium_contacts(here)
        spread = (second.s - first.s) * (2 * first.pressure + second.pressure) / 6
        found.append([first.s, last.s, np.linalg.norm(first.force) - spread])
    coarse, fine = (np.abs(np.array(one) - np.array(found[-1])) for one in found[:2])
    assert (np.log2(coarse / fine) > 4).all()


# Without load steps these lengths were reported as not met.
@pytest.mark.slow
def test_lengths_in_contact_are_met_by_load_steps() -> None:
    asked = query(9025)
    wanted = settle(asked.arm, asked.tensions, asked.scene, 1e-4)
    shape = settle(asked.arm, None, asked.scene, 1e-4, lengths=wanted.tendon_lengths)
    assert shape.contacts
    check_complementary(shape)
    assert np.linalg.norm(shape.tip - wanted.tip) <= 1e-6 * asked.arm.length
