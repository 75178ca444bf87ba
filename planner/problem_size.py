"""How large the functions of a scene are: what its effects cost, counted."""

from __future__ import annotations

from dataclasses import dataclass

from model.arm import Arm
from model.forward import collocation_map, explicit_map, schemes_of
from model.loads import is_loaded
from model.scene import Scene


@dataclass(frozen=True)
class ProblemSize:
    """Counts that do not depend on the machine.

    Attributes
    ----------
    states : int
        Numbers carried along the arm: the pose, and what is integrated with it.
    unknowns, constraints : int
        Of the boundary value problem; none where the shape is an explicit function.
    instructions : int
        Elementary operations to evaluate the shape, or the constraints, on the coarsest mesh.
    """

    states: int
    unknowns: int
    constraints: int
    instructions: int


def problem_size(arm: Arm, scene: Scene) -> ProblemSize:
    """Return the sizes of a scene's functions, by the scheme that is used unless one is named."""
    scheme = schemes_of(scene)[0]
    if not is_loaded(scene):
        function = explicit_map(arm, scene, scheme, 1).function
        carried = 7 + (function.size1_out(2) if function.n_out() > 2 else 0)
        return ProblemSize(carried, 0, 0, function.expand().n_instructions())
    of = collocation_map(arm, scene, scheme, 1).system.of
    instructions = sum(
        term.count * term.kernel.value.n_instructions() for term in of.equations.terms
    )
    return ProblemSize(of.node_size + of.form.strains, of.n_states, of.n_states, instructions)
