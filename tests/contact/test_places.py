"""How places of contact are found: in few rounds, past nodes that stay and next to corners."""

import numpy as np
import pytest

import model.contact.moving
from model import Scene
from model.contact.root import Root
from model.contact.touches import Touches
from model.effects import Contact, ExactTendons, Extension
from model.equilibrium.linearised import Linearised
from model.obstacles import Capsule
from model.paths import Array
from planner.contact.equilibria import Equilibria
from tests.contact.cases import bar

L = 0.3
ARM = bar(L, 0.006, 2e5)
ROD = Capsule((0.2, -0.1, -0.07), (0.2, 0.1, -0.07), 0.05)
SCENE = Scene(Extension(), ExactTendons(), Contact(ROD))


def test_a_place_goes_past_nodes_that_stay_in_few_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each round took it half of what was left up to the next of them: some 20 rounds a node."""
    rounds = [0]
    found = model.contact.moving.held_shut

    def counted(*asked: object) -> object:
        rounds[0] += 1
        return found(*asked)  # type: ignore[arg-type]

    def touched(here: Linearised) -> Array:
        return np.asarray(here.system.mesh.s[Touches.of(here.system).held[:, 0]])

    weak, strong = np.array([0.0, 0.3, 0.0, 0.0]), np.array([0.0, 0.45, 0.0, 0.0])
    free, stays = Equilibria(ARM, SCENE, (), 1), tuple(np.linspace(0.2, 0.25, 33).tolist())
    first, last = (touched(free.at(T, None)[0])[0] for T in (weak, strong))
    passed = [s for s in stays if min(first, last) < s < max(first, last)]
    assert len(passed) > 2
    among = Equilibria(ARM, SCENE, stays, 1)
    begin = among.at(weak, None)
    monkeypatch.setattr(model.contact.moving, "held_shut", counted)
    there = among.at(strong, begin)[0]
    assert touched(there)[0] == pytest.approx(last, abs=1e-4 * L)
    assert rounds[0] < 20


@pytest.mark.parametrize("beside", [1e-3, 1e-5, 1e-7])
def test_a_root_next_to_a_value_of_the_other_sign_is_found_at_once(beside: float) -> None:
    """It is looked for on the line between the two, as at a corner that a point has just left."""
    root = Root([(1.0, beside)])
    s = root.next(0.98, 0.98 - (1.0 - beside), 1.1, 0.2)
    assert s == pytest.approx(1.0 - beside, abs=1e-12)
