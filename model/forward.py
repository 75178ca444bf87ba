"""The forward maps, tensions to poses, by name: which scheme carries a scene, built once each."""

from __future__ import annotations

from functools import lru_cache
from itertools import zip_longest

import numpy as np

from model.arm import Arm
from model.contact.forward import TouchingMap
from model.effects import PrintedStatics
from model.equilibrium.newton import Collocation
from model.errors import InputError
from model.integrators import MAGNUS2, MAGNUS4, MAGNUS6, RK4, RK6, RK8
from model.loads import check_loads, contacts, convergence_order, is_loaded
from model.mesh import IMPLICIT, ROUNDING
from model.scene import Scene
from model.transcription.system import system
from model.unloaded.closed_form import ClosedForm
from model.unloaded.marched import March
from model.unloaded.printed import PrintedMap

# By name: closed forms, stages of collocation, and integrators of the equations as printed. Of each
# the first is used unless another is named.
CLOSED_FORMS = {scheme.name: scheme for scheme in (MAGNUS6, MAGNUS4, MAGNUS2)}
COLLOCATIONS = {"gauss6": 3, "gauss4": 2, "gauss2": 1, "gauss8": 4}
PRINTED = {scheme.name: scheme for scheme in (RK6, RK8, RK4)}
SCHEMES = (*CLOSED_FORMS, *COLLOCATIONS, *PRINTED)

ForwardMap = Collocation | March


def schemes_of(scene: Scene) -> tuple[str, ...]:
    """Return the names of the schemes that can carry a scene.

    First the one that is used unless another is named, then the one that checks it.
    """
    if scene.has(PrintedStatics):
        return tuple(PRINTED)
    if is_loaded(scene):
        return tuple(COLLOCATIONS)
    pairs = zip_longest(CLOSED_FORMS, COLLOCATIONS)
    return tuple(name for pair in pairs for name in pair if name)


def check_scheme(scene: Scene, scheme: str | None) -> str:
    """Return the scheme by name, the scene's first for None; InputError if it cannot carry it."""
    allowed = schemes_of(scene)
    if scheme is not None and scheme not in allowed:
        raise InputError("scheme", scheme, ", ".join(allowed) + " in this scene")
    return scheme or allowed[0]


def by_collocation(
    arm: Arm,
    scene: Scene,
    stages: int,
    refinement: int,
    at: tuple[float, ...] = (),
    loaded: bool | None = None,
    machine_code: bool = False,
) -> Collocation:
    """Return the forward map by collocation with so many stages.

    With torsion, moment and force where it is `loaded`, as the scene is unless told.
    """
    if contacts(scene):
        return TouchingMap(arm, scene, stages, refinement, at, machine_code)
    loaded = is_loaded(scene) if loaded is None else loaded
    return Collocation(system(arm, scene, stages, refinement, at, loaded, machine_code))


def explicit_map(
    arm: Arm,
    scene: Scene,
    scheme: str,
    refinement: int,
    at: tuple[float, ...] = (),
    machine_code: bool = False,
) -> ClosedForm | PrintedMap:
    """Return the forward map in closed form or as printed on a mesh; see Maps.on.

    CasADi cannot differentiate its `function` where its kernels are compiled.
    """
    if scheme in PRINTED:
        return PrintedMap(arm, scene, PRINTED[scheme], refinement, at, machine_code)
    return ClosedForm(arm, scene, CLOSED_FORMS[scheme], refinement, at, machine_code)


class Maps:
    """The forward maps of an arm in a scene by a scheme, mesh by mesh.

    Raises InputError for loads that the arm cannot have.

    Attributes
    ----------
    order, least_order : int
        Of the scheme where all is smooth, and that error estimates in this scene count on.
    rounding : float
        What it leaves of the tip's error over the arm's length.
    lever : float
        How far off the tip the error is looked at as well [m]: loads can twist a straight arm.
    by_sections : bool
        Whether strains that are no numbers say that a section has no equilibrium; as printed they
        may be those of a step that is too long.
    """

    def __init__(self, arm: Arm, scene: Scene, scheme: str, machine_code: bool) -> None:
        check_loads(arm, scene, contact=True)
        self.arm, self.scene, self.scheme, self.machine_code = arm, scene, scheme, machine_code
        explicit, self.stages = (CLOSED_FORMS | PRINTED).get(scheme), COLLOCATIONS.get(scheme, 0)
        self.order, self.rounding = 2 * self.stages, IMPLICIT
        if explicit:
            self.order, self.rounding = explicit.order, ROUNDING
        self.contacts, self.least_order = contacts(scene), convergence_order(scene, self.order)
        base = float(arm.radius.evaluate(np.zeros(1), arm.length)[0][0])
        self.lever, self.by_sections = base * is_loaded(scene), not scene.has(PrintedStatics)
        self._kept: dict[int, ForwardMap] = {}

    def on(self, refinement: int, at: tuple[float, ...] = ()) -> ForwardMap:
        """Return the forward map on the mesh of a refinement, which is kept.

        Not with arc lengths `at` as further nodes: there may be many.
        """
        if refinement in self._kept and not at:
            return self._kept[refinement]
        of, mesh, code = (self.arm, self.scene), (refinement, at), self.machine_code
        result: ForwardMap
        if self.stages:
            result = by_collocation(*of, self.stages, *mesh, machine_code=code)
        else:
            result = explicit_map(*of, self.scheme, *mesh, code)
        if not at:
            self._kept[refinement] = result
        return result


@lru_cache(maxsize=64)
def maps_of(arm: Arm, scene: Scene, scheme: str | None, machine_code: bool) -> Maps:
    """Return the forward maps by a scheme, the scene's first for None."""
    return Maps(arm, scene, check_scheme(scene, scheme), machine_code)
