"""Contact with rigid obstacles and with the arm itself: the effects, and those of a scene."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from octoplan.model.effects.base import Effect, EffectSet, Rules
from octoplan.model.extensions.contact.term import ContactTerm
from octoplan.model.extensions.obstacles.base import Convex, convex_parameters
from octoplan.model.paths import Array
from octoplan.model.rod.rod_term import RodTerm
from octoplan.model.scene import Scene
from octoplan.model.support.errors import Described, InputError
from octoplan.model.support.value import NotNegative, value

if TYPE_CHECKING:
    from octoplan.model.arm import Arm
    from octoplan.model.extensions.contact.forward import TouchingMap
    from octoplan.model.settle import SettlingProblem
    from octoplan.model.shape import Shape

_SLIDING = "Friction", "tendons that slide where contact bends them sharply are not stated"


@value
class Contact(Effect):
    """A rigid obstacle that the arm's surface may not enter, and that presses it back.

    The surface is that of balls of the arm's radius along its midline, as clearances have it: the
    gap at s is the distance of the midline from the obstacle less the radius. At each place gap
    >= 0, force >= 0, gap times force = 0 (Signorini's conditions). The force acts along the
    obstacle's normal through the midline: on a tapered arm it leans by the slope of the radius
    against the cross-section, and has no moment about it. A scene may have several contacts, with
    different obstacles; it adds torsion, moment, force and contact force at the nodes. A
    neo-Hookean body swells where it is shortened; that it is squeezed where it leans is left out.

    Friction is Coulomb's, in quasi-static steps: with N what presses at a place and d how far the
    midline there has slipped along the obstacle in the step before, either d = 0 and the friction
    is at most mu N, or it is mu N against d. So it takes a motion: `settle(..., near=before)` leads
    tensions in a straight line, in eight steps or more, from those of a shape that is known, such
    as one that touches nothing or one settled without friction; `plan(..., near=before)` finds such
    tensions. Points that roll are off by what they roll in a step. What more steps would change is
    no part of `Shape.error`: it falls about as steps do, but unevenly, by when in a step a touch
    begins, so that two of their numbers do not tell it. From eight steps to sixteen up to 5e-3 of
    the length was seen, from 64 to 128 1e-3; `Shape.remarks` has it. Settle shapes in between, each
    near the one before, to see it. Friction acts on the midline: its moment about it, of its size
    times the arm's radius, and that the arm may roll sideways, are left out. Where the arm lies
    along an obstacle the scene has to have Extension, without which forces along the arm between
    places that stick are undetermined; friction there is spread as the pressure is, and where
    sticking and slipping meet is known to a node.

    Attributes
    ----------
    obstacle : Convex
        Such as a Sphere, Capsule, Box or HalfSpace.
    friction : float
        Coulomb's coefficient mu between arm and obstacle.
    """

    plan_strategy = "contact"
    has_complementarity = True

    obstacle: Convex
    friction: NotNegative = 0.0

    @property
    def is_path_dependent(self) -> bool:
        """See Effect: friction acts against the motion."""
        return self.friction > 0

    @property
    def place(self) -> tuple[Any, ...]:
        """The numbers of the obstacle."""
        return tuple(self.obstacle.parameters.tolist())

    @classmethod
    def excludes(cls) -> Rules:
        """See Effect."""
        return (_SLIDING,)

    def check_arm(self, arm: Arm) -> None:
        """See Effect."""
        check_continuous_guides(arm)

    def rod_term(self, scene: EffectSet) -> RodTerm | None:
        """Return the term of all contacts of a scene, from the first of them."""
        all_contacts = [effect for effect in scene.effects if isinstance(effect, Contact)]
        if self != all_contacts[0]:
            return None
        bodies = convex_parameters([contact.obstacle for contact in all_contacts])
        mu = tuple(contact.friction for contact in all_contacts)
        return ContactTerm(tuple(map(tuple, bodies.tolist())), mu)

    def comparable(self) -> Contact:
        """See Effect: friction may differ between two shapes of a motion."""
        return replace(self, friction=0.0)

    def rotated(self, rotation: Array) -> None:
        """See Effect: obstacles are not rotated."""

    def check_supported(self, contact: bool) -> None:
        """See Effect."""
        if not contact:
            allowed = (
                "a scene without contact; settle, settle_many, stiffness, plan and trajectory "
                "support contact"
            )
            raise InputError("scene", Described("a scene with contact"), allowed)

    def forward_map(
        self, arm: Arm, scene: Scene, refinement: int, at: tuple[float, ...], machine_code: bool
    ) -> TouchingMap:
        """See Effect."""
        from octoplan.model.extensions.contact.forward import TouchingMap

        return TouchingMap(arm, scene, refinement, at, machine_code)

    def remark(self, shape: Shape) -> str:
        """See Effect: friction depends on the load steps."""
        from octoplan.model.extensions.contact.points import step_remark

        return step_remark(shape)


@value
class SelfContact(Effect):
    """Parts of the arm that meet press each other apart, without friction.

    The surface is that of balls of the arm's radius along its midline, as for clearances and
    contact: the gap between the places s1 < s2 is the distance of the midlines less both radii. Of
    places between which the arm has turned by half a turn, so that they are farther along than
    their own thickness, gap >= 0, force >= 0, gap times force = 0. The forces are equal and
    opposite, along the line that joins the midlines, at pairs of points where the gap is least. A
    neo-Hookean body swells where it is shortened; that it is squeezed where it presses is left out.

    `settle` states it, `Shape.contacts` has both forces of each pair. It goes with all statics and
    dead loads, but not with Contact, Friction or PrintedStatics; plans, stiffness, motions and
    tendons held by length do not state it and refuse it.
    """

    has_complementarity = True
    settles_scene = True

    @classmethod
    def excludes(cls) -> Rules:
        """See Effect."""
        return ("Contact", "what presses on both an obstacle and itself is not stated"), _SLIDING

    def check_supported(self, contact: bool) -> None:
        """See Effect."""
        allowed = (
            "a scene without SelfContact, which only settle with tensions supports; pass "
            "self_clearance=True to keep a plan or motion clear of itself"
        )
        raise InputError("scene", Described("a scene with SelfContact"), allowed)

    def settle(self, problem: SettlingProblem) -> Shape:
        """See Effect."""
        from octoplan.model.extensions.contact.self_contact import settle_with_self_contact

        return settle_with_self_contact(problem)


def check_continuous_guides(arm: Arm) -> None:
    """Raise InputError for tendons that run straight between guides."""
    if arm.is_guided:
        allowed = "None, continuous guides, in a scene with contact"
        raise InputError("Anchorage.guides", Described("spacer discs"), allowed)


def contacts(scene: Scene) -> tuple[Contact, ...]:
    """Return the contacts of a scene."""
    return tuple(effect for effect in scene.effects if isinstance(effect, Contact))


def bodies_of(scene: Scene) -> Array:
    """Return the parameters (K, 17) of the obstacles in contact; see Convex.parameters."""
    return convex_parameters([contact.obstacle for contact in contacts(scene)])


def without_contacts(scene: Scene) -> Scene:
    """Return the scene without contact with obstacles."""
    return Scene(*(effect for effect in scene.effects if not isinstance(effect, Contact)))


def without_self_contact(scene: Scene) -> Scene:
    """Return the scene without SelfContact."""
    return Scene(*(effect for effect in scene.effects if not isinstance(effect, SelfContact)))


def without_friction(scene: Scene) -> Scene:
    """Return the scene with contacts that have no friction."""
    return Scene(
        *(replace(e, friction=0.0) if isinstance(e, Contact) else e for e in scene.effects)
    )
