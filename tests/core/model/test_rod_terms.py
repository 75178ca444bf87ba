"""Rod terms of equal structure have the same expressions: all numbers are parameters."""

from collections.abc import Iterator

import pytest

from octoplan import Contact, Friction, Scene, Sphere
from octoplan.model.cross_section.law import RubberSection
from octoplan.model.effects import Current, PointLoad, PointMass, TipLoad, Weight
from octoplan.model.effects.base import Effect
from octoplan.model.rod.element import element, node
from octoplan.model.rod.kernels import Kernel
from octoplan.model.rod.rod_term import RodTerm
from octoplan.model.rod.structure import RodStructure, TermStructure
from octoplan.model.rod.tendons import body, tendon_in_element, tendon_jump

PAIRS: dict[str, tuple[Effect, Effect]] = {
    "weight": (Weight(), Weight((1.0, 2.0, 3.0))),
    "current": (Current((0.1, 0.0, 0.0)), Current((0.0, 0.2, 0.1), 900.0, 1.2)),
    "dead tip load": (TipLoad((0.1, 0.0, 0.0)), TipLoad((0.0, 0.2, 0.0), (0.1, 0.0, 0.0))),
    "follower": (TipLoad((0.1, 0, 0), follower=True), TipLoad((0, 0.2, 0), follower=True)),
    "point load": (PointLoad(0.1, (0.1, 0.0, 0.0)), PointLoad(0.2, (0.0, 0.2, 0.0))),
    "point mass": (PointMass(0.1, 0.1, (0.0, 0.1, 0.0)), PointMass(0.2, 0.2, (0.1, 0.0, 0.0))),
    "friction": (Friction(0.1), Friction(0.2, -1)),
    "contact": (Contact(Sphere((0.1, 0.2, 0.3), 0.1)), Contact(Sphere((0.3, 0.2, 0.1), 0.2))),
}


def term_of(effect: Effect) -> RodTerm:
    scene = Scene(effect) if not isinstance(effect, PointMass) else Scene(effect, Weight())
    term = effect.rod_term(scene)
    assert term is not None
    return term


def kernels(term: RodTerm) -> Iterator[Kernel]:
    each = TermStructure(term)
    structure = RodStructure(
        law=RubberSection(extension=True),
        stages=3,
        has_force=term.depends_on_shape,
        term_structures=(each,),
    )
    yield element(structure)
    yield body(structure)
    yield node("node", each, structure.n_wrench)
    if structure.couples_stages:
        yield tendon_in_element(structure)
        yield tendon_jump(structure)


@pytest.mark.parametrize("name", PAIRS)
def test_numbers_of_an_effect_are_parameters(name: str) -> None:
    one, other = (term_of(effect) for effect in PAIRS[name])
    assert TermStructure(one) == TermStructure(other)
    for first, second in zip(kernels(one), kernels(other), strict=True):
        assert first.value.serialize() == second.value.serialize()
