"""Contact with rigid obstacles and of the arm with itself: effects, and the contacts of a scene."""

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
    """A rigid obstacle on which the arm can lean.

    The surface of the arm is the envelope of balls of the arm's radius along the midline, as for
    clearances: the gap at s is the distance of the midline from the obstacle minus the radius. At
    each s the gap and the force are at least 0, and one of both is 0 (Signorini's conditions). The
    force acts along the normal of the obstacle through the midline: on a tapered arm the force is
    inclined to the cross-section by the slope of the radius, and has no moment about the midline. A
    scene may have several contacts with different obstacles. Contact adds torsion, moment, force
    and contact force to the unknowns at the nodes. A neo-Hookean body widens if the body shortens;
    the deformation of the cross-section by the contact is neglected.

    Friction follows Coulomb's law in quasi-static steps. Let N be the normal force at a point and d
    the slip of the midline along the obstacle in the last step: either d = 0 and the friction is at
    most mu N, or the friction is mu N and opposes d. Friction therefore needs a motion.
    `settle(..., near=before)` moves the tensions along a straight line, in eight or more steps,
    from the tensions of the shape `before`, for example a shape without contact or a shape settled
    without friction. `plan(..., near=before)` plans from such a shape. The slip of a rolling point
    has an error of its path in one step. `Shape.error` excludes the effect of more steps, which
    falls unevenly: a contact may begin at any time in a step. Doubling 8 steps moved the tip by up
    to 5e-3 of the length, doubling 64 steps by 1e-3; `Shape.remarks` repeats this. Settle
    intermediate shapes, each near the last one, to measure the effect. Friction acts on the
    midline: the moment of the friction about the midline (friction times radius) and sideways
    rolling are neglected. Friction along a part of the arm requires Extension: otherwise the axial
    forces between sticking points are undetermined. On such a part, friction is distributed like
    the pressure, and the place between sticking and slipping is resolved to one element.

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
        """Return the term of all contacts of a scene for the first contact, None for the others."""
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
    """Contact between parts of the arm, without friction.

    The surface of the arm is the envelope of balls of the arm's radius along the midline, as for
    clearances and contact: the gap between s1 < s2 is the distance of both points of the midline
    minus both radii. If the arm turns by at least half a turn between both points, the gap and the
    force are at least 0, and one of both is 0. The forces are opposite, along the line between both
    points of the midline, at pairs of points with the least gap. A neo-Hookean body widens if the
    body shortens; the deformation of the cross-section by the contact is neglected.

    `settle` supports this effect with given tensions; `Shape.contacts` has both forces of each
    pair. All statics and dead loads can be combined with SelfContact, but not Contact, Friction and
    PrintedStatics. Plans, stiffness, motions and given tendon lengths refuse scenes with
    SelfContact.
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
