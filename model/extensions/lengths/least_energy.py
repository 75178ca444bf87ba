"""Equilibrium as minimum of the potential energy, subject to lengths and gaps; by ipopt.

    minimise    sum h b_i (W(v_i) + sum T |u_c'|(v_i)) - work of dead loads + sum e_j^2 / 2 c_j
    subject to  pose_{k+1} = F(pose_k, v_k) from the clamped base on,
                length_j - e_j <= length_j of the winch, for each tendon that a winch holds,
                gap(u_k) >= 0 at the nodes, for each obstacle.

The variables are poses at the nodes, strains at the Gauss stages of the elements, and elongations
e_j of tendons with compliance c_j. The local minima are the stable equilibria. The multipliers are
the tensions of tendons held by length, 0 for slack tendons, and the contact forces.

Lengths are in units of the arm's length, forces in units of E J / L^2 at the base.

Nonconservative forces (the paper's tangent, followers, currents, friction of tendons) enter as
constant generalised forces on the strains: the residuals of the equilibrium equations at the
previous minimum. The minimisation is repeated until these forces converge.

Sources: Nocedal and Wright, Numerical Optimization (2006), chapter 19; Waechter and Biegler, Math.
Programming 106 (2006), for ipopt.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from octoplan.model.centreline import outer_radii
from octoplan.model.cross_section.law import EnergySection, ExactSection, body_parameters
from octoplan.model.cross_section.sections import reported, strains_of
from octoplan.model.extensions.guides import GuideTerm
from octoplan.model.extensions.lengths.energy import Spans, held_rows, potential_energy
from octoplan.model.extensions.lengths.winches import Winches
from octoplan.model.extensions.obstacles.base import convex_parameters
from octoplan.model.loads import (
    dead_resultant,
    has_complementarity,
    is_conservative,
    rod_terms,
)
from octoplan.model.mesh import base_pose, stations, tendon_paths
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.discrete_rod import DiscreteRod
from octoplan.model.rod.equations import AssembledValue
from octoplan.model.rod.layout import Layout, layout
from octoplan.model.rod.load_terms import (
    CouplingTerm,
    DeadLineTerm,
    DeadTipTerm,
    PointForceTerm,
    WeightTerm,
)
from octoplan.model.rod.rod_term import RodTerm
from octoplan.model.rod.structure import RodStructure
from octoplan.model.rotations import POSE
from octoplan.model.scene import Scene
from octoplan.model.support.machine.functions import BufferedFunction
from octoplan.model.tendons import least_compliance

LOG = logging.getLogger(__name__)

# Options of ipopt; tolerances are in the units of the program.
_IPOPT: dict[str, Any] = {
    "tol": 1e-9,
    "constr_viol_tol": 1e-10,
    "print_level": 0,
    "sb": "yes",
    "max_iter": 100,
    "bound_relax_factor": 0.0,
    "mu_strategy": "adaptive",
    # Multipliers of fixed variables would require another gradient in each step.
    "fixed_variable_treatment": "make_parameter_nodual",
}
# Terms whose potential is part of the energy; the forces of others are treated as nonconservative.
_REPRESENTED = (CouplingTerm, DeadLineTerm, DeadTipTerm, PointForceTerm, WeightTerm)
# Largest number of updates of the nonconservative forces.
ROUNDS = 12
# Curvature of the initial guess of an arm with guides, times the arm's length [rad].
_IMPERFECTION = 1e-3
# Change of a frame's quaternion up to which a disturbed arm has returned, if all forces have a
# potential: disturbances turn frames by up to 1e-3 / 7.
_RETURNED = 1e-5
# Change of a frame's quaternion at which the updates end.
_STAYS = 1e-3


@dataclass(frozen=True, eq=False)
class Minimum:
    """An equilibrium as local minimum of the energy.

    Attributes
    ----------
    x : (n,)
        Variables in the units of the program: states, then elongations of tendons.
    tensions : (n_tendons,)
        Given tensions, and multipliers of lengths [N].
    forces : (N, K)
        Nonnegative forces of K obstacles on each node except the base [N].
    nonconservative : (N stages, strains)
        Minus the generalised forces without potential: moments [N m], forces [N].
    """

    x: Array
    tensions: Array
    forces: Array
    nonconservative: Array


class LeastEnergy:
    """Minimisation of the energy of an arm in a scene, on a mesh.

    Attributes
    ----------
    system : DiscreteRod
        Equilibrium equations on the same mesh.
    layout : Layout
        Layout of the program's states: poses and strains.
    conservative : bool
        Whether all forces have a potential.
    force_unit : float
        Force that bends the arm, E J / L^2 at the base [N].
    """

    def __init__(self, system: DiscreteRod) -> None:
        self.system = system
        arm = system.arm
        scene = system.scene
        mesh = system.mesh
        structure = system.layout.structure
        m = structure.stages
        L = arm.length
        law = structure.law
        if not isinstance(law, EnergySection):
            law = ExactSection(law.extension, law.torsion, law.shear, law.curved)
        kinematics = RodStructure(law, m, has_moment=False)
        self.layout = layout(kinematics, system.layout.ends, mesh.elements)
        levers = [each for each in scene.rod_terms if isinstance(each, PointForceTerm)]
        levers = [each for each in levers if each.offset]
        self._lever_nodes = tuple(node for each in levers for node in each.nodes(mesh))
        self._bodies, contact_terms = _contacts(scene)
        guides = [each for each in rod_terms(arm, scene) if isinstance(each, GuideTerm)]
        self._spans: Spans = sum((each.span_nodes(mesh) for each in guides), ())
        self._span_offsets = np.hstack(
            [np.zeros((4, 0)), *(each.offsets(arm) / L for each in guides)]
        )
        kinds = _REPRESENTED + contact_terms
        represented = all(isinstance(each, kinds) for each in scene.rod_terms)
        self.conservative = law == structure.law and is_conservative(scene) and represented
        self.force_unit = F = arm.bending_force
        self._unit = np.ones(self.layout.n_states)
        self._unit[self.layout.nodes[:, 4:]] = L
        self._unit[self.layout.stages[:, : 2 + law.torsion]] = 1 / L
        at = stations(arm, system.s, np.repeat(mesh.active, m))
        self._stage, self._tendon = self.layout.crossings
        self._h = np.diff(mesh.s)[None] / L
        self._weights = np.outer(self._h, gauss(m).b).ravel()
        unit_of_body = np.repeat([F, F * L**2, F, 1 / L], [1, 3, 1, 2 * law.curved])
        self._body = body_parameters(arm, scene, at) / unit_of_body[:, None]
        self._paths = tendon_paths(arm, at, self._stage, self._tendon) / np.array(
            [[L], [L], [1], [1]]
        )
        end = np.repeat(mesh.s[1:], m)
        dead = dead_resultant(arm, scene, system.s, end).reshape(3, mesh.elements, m)
        self._dead = dead.transpose(2, 0, 1).reshape(-1, mesh.elements) / F
        offsets = np.array([each.offset for each in levers]).reshape(-1, 3)
        rows = np.hstack([offsets, np.array([each.force for each in levers]).reshape(-1, 3)])
        self._levers = rows.T / np.repeat([L, F], 3)[:, None]

    def at_rest(self) -> Minimum:
        """Return the arm without tensions and loads, as initial guess.

        Arms with guides are bent slightly; see `disturbed`.
        """
        law = self.layout.structure.law
        v = np.zeros(self.layout.stages.shape)
        i = 2 + law.torsion
        v[:, i : i + 1] = law.along_at_rest
        if law.curved:
            v[:, i - 2 : i] = self._body[-2:].T / self.system.arm.length
        if self._spans:
            v = self._disturbed(v)
        return self._at(v, np.zeros(self.layout.n_tendons))

    def _disturbed(self, v: Array) -> Array:
        """Return strains of the energy's law with small further curvatures.

        At a straight span the gradient of the energy has no component along its buckling mode:
        without disturbance the minimisation may end at a saddle point.
        """
        L = self.system.arm.length
        i = 2 + self.layout.structure.law.torsion
        bent = v.copy()
        bent[:, i - 2 : i] += _IMPERFECTION / L * np.cos(np.outer(self.system.s / L, (9.0, 7.0)))
        return bent

    def is_minimum(self, tensions: Array, strains: Array, winches: Winches) -> bool:
        """Return whether the minimisation returns to an equilibrium after a small disturbance."""
        there = self.near(tensions, strains)
        v = self._states(there)[self.layout.stages]
        after = self.minimise(self._at(self._disturbed(v), tensions), winches.tensions, 1, winches)
        if after is None:
            return False
        moved = np.abs(self.nodes(after)[:, :4] - self.nodes(there)[:, :4]).max()
        return bool(moved < (_RETURNED if self.conservative else 10 * _STAYS))

    def near(self, tensions: Array, strains: Array) -> Minimum:
        """Return the initial guess for strains of the equations' law (N stages, strains)."""
        law = self.layout.structure.law
        law_of_system = self.system.layout.structure.law
        if law != law_of_system:
            strains = strains_of(law, reported(law_of_system, strains))
        return self._at(strains, tensions)

    def _at(self, v: Array, tensions: Array) -> Minimum:
        """Return the initial guess for strains of the energy's law (N stages, strains)."""
        x = np.zeros(self.layout.n_states)
        x[self.layout.stages] = v
        x[self.layout.nodes] = self.system.integrate_poses(self._of_system(v))
        forces = np.zeros((self.system.mesh.elements, len(self._bodies)))
        return Minimum(np.append(x / self._unit, 0 * tensions), tensions, forces, 0 * v)

    def _states(self, point: Minimum) -> Array:
        """Return the states of the program (n_states,) in SI units."""
        return point.x[: self.layout.n_states] * self._unit

    def strains(self, point: Minimum) -> Array:
        """Return the strains of the equations' law (N stages, strains)."""
        return self._of_system(self._states(point)[self.layout.stages])

    def _of_system(self, v: Array) -> Array:
        law = self.layout.structure.law
        law_of_system = self.system.layout.structure.law
        return v if law == law_of_system else strains_of(law_of_system, reported(law, v))

    def states(self, point: Minimum, load: float = 1.0) -> Array:
        """Return the states of the equilibrium equations (n_states,)."""
        known = None
        if point.forces.size:
            from octoplan.model.extensions.contact.term import contact_places

            known = contact_places(self.system.layout).touches[1:, :, 0], point.forces
        return self.system.initial_states(point.tensions, self.strains(point), load, known)

    def lengths(self, point: Minimum) -> Array:
        """Return the lengths of the tendons (n_tendons,) [m]."""
        return self.system.lengths(self.system.x(point.tensions, 1.0, self.states(point)))

    def nodes(self, point: Minimum) -> Array:
        """Return the poses at the nodes (N + 1, 7)."""
        return self._states(point)[self.layout.nodes]

    def minimise(
        self,
        near: Minimum,
        tensions: Array,
        load: float = 1.0,
        winches: Winches | None = None,
        rounds: int = ROUNDS,
    ) -> Minimum | None:
        """Minimise the energy from an initial guess; return None if ipopt fails.

        `tensions` (n_tendons,) are the given tensions of tendons without winch, `load` is a factor
        of the loads, and `rounds` is the largest number of updates of nonconservative forces.
        """
        point = near
        for _ in range(1 if self.conservative else rounds):
            after = self._minimum(point, tensions, load, winches)
            if after is None or self.conservative:
                return after
            residual = self.system.residual(
                self.system.x(after.tensions, load, self.states(after, load))
            )
            turned = np.abs(self.nodes(after)[:, :4] - self.nodes(point)[:, :4]).max()
            forces = after.nonconservative + residual[self.system.layout.stages]
            point = replace(after, nonconservative=forces)
            if turned < _STAYS:
                break
        return point

    def _minimum(
        self,
        near: Minimum,
        tensions: Array,
        load: float,
        winches: Winches | None,
    ) -> Minimum | None:
        """Return the minimum of the energy at constant nonconservative forces; None on failure."""
        F = self.force_unit
        L = self.system.arm.length
        K = len(self._bodies)
        n = self.layout.n_states
        n_tendons = self.layout.n_tendons
        n_poses = POSE * self.layout.elements
        held = np.zeros(n_tendons, dtype=bool) if winches is None else winches.held
        # Without compliance, antagonists with undetermined tensions would pull without bound.
        given = np.zeros(n_tendons) if winches is None else winches.stretch
        stretch = np.where(held, given + least_compliance(self.system.arm), 0.0) * F / L
        forces = (near.nonconservative * self._unit[self.layout.stages]).T / F
        paths = np.vstack([self._paths, self._weights[self._stage]])
        pulled_paths = np.vstack([self._paths, paths[-1] * tensions[self._tendon] / F])
        span_tensions = tensions[[j for j, _, _ in self._spans]] / F
        parameters = [
            np.vstack([self._weights, self._body, forces]),
            pulled_paths,
            np.vstack([self._span_offsets, span_tensions]),
            np.vstack([self._h, load * self._dead]),
            self._levers * np.repeat([1.0, load], 3)[:, None],
            np.divide(1.0, stretch, out=np.zeros(n_tendons), where=held),
            self._h,
            paths,
            self._span_offsets,
        ]
        if K:
            bodies = np.tile(self._bodies.T, self.layout.elements)
            radii = np.repeat(outer_radii(self.system, self.strains(near)) / L, K)
            parameters.append(np.vstack([bodies, radii, np.full(radii.size, L)]))
        base = base_pose(self.system.arm) / self._unit[:POSE]
        free = np.full(n - POSE, np.inf)
        elongations = np.where(held, np.inf, 0.0)
        lengths = np.full(n_tendons, np.inf)
        if winches is not None:
            lengths[held] = winches.lengths[held] / L
        gaps = np.zeros(self.layout.elements * K)
        rows_low = np.concatenate([np.zeros(n_poses), np.full(n_tendons, -np.inf), gaps])
        rows_high = np.concatenate([np.zeros(n_poses), lengths, gaps + np.inf])
        solver = _solver(self.layout, K, self._lever_nodes, self._spans)
        x, _, _, _, lam, _ = solver(
            near.x,
            np.concatenate([np.ravel(part, "F") for part in parameters]),
            np.concatenate([base, -free, -elongations]),
            np.concatenate([base, free, elongations]),
            rows_low,
            rows_high,
            np.zeros(n + n_tendons),
            np.zeros(rows_low.size),
        )
        stats = solver.stats()
        LOG.debug(
            "least energy: %s after %d iterations", stats["return_status"], stats["iter_count"]
        )
        if stats["return_status"] not in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
            return None
        multipliers = lam.ravel()
        pulls = np.maximum(F * multipliers[n_poses : n_poses + n_tendons], 0.0)
        pressed = np.maximum(-F * multipliers[n_poses + n_tendons :], 0.0)
        pressed = pressed.reshape(self.layout.elements, K)
        return replace(near, x=x.ravel(), tensions=tensions + pulls, forces=pressed)


@lru_cache(maxsize=32)
def _solver(
    layout: Layout, obstacles: int, levers: tuple[int, ...], spans: Spans
) -> BufferedFunction:
    """Return ipopt for a structure, with arguments x0, p, lbx, ubx, lbg, ubg, lam_x0, lam_g0.

    The parameters p belong to the energy and to the constraints.
    """
    f = potential_energy(layout, levers, spans)
    g = held_rows(layout, obstacles, spans)
    z = ca.MX.sym("z", f.n_x)
    p = ca.MX.sym("p", f.n_p + g.n_p)
    lam = ca.MX.sym("lam", g.n_g)
    sigma = ca.MX.sym("sigma")
    energy_parameters = p[: f.n_p]
    row_parameters = p[f.n_p :]
    value = f.value.function(z, energy_parameters)
    rows = g.value.function(z, row_parameters)

    def matrix(value: AssembledValue, *arguments: ca.MX) -> ca.MX:
        return ca.MX(value.places, value.function(*arguments))

    # The derivative functions also return the values, which cost less in the value functions.
    ends = [0, f.n_x, f.n_x + 1]
    gradient, same_value = ca.horzsplit(matrix(f.jacobian, z, energy_parameters), ends)
    J, same_rows = ca.horzsplit(matrix(g.jacobian, z, row_parameters), ends)
    gradient = ca.densify(gradient).T
    H = ca.triu(
        matrix(f.hessian, z, energy_parameters, sigma) + matrix(g.hessian, z, row_parameters, lam)
    )
    options: dict[str, Any] = {
        "print_time": False,
        "show_eval_warnings": False,
        "calc_lam_p": False,
        "no_nlp_grad": True,
        "error_on_fail": False,
        "grad_f": ca.Function(
            "nlp_grad_f", [z, p], [same_value, gradient], ["x", "p"], ["f", "grad:f:x"]
        ),
        "jac_g": ca.Function("nlp_jac_g", [z, p], [same_rows, J], ["x", "p"], ["g", "jac:g:x"]),
        "hess_lag": ca.Function(
            "nlp_hess_l",
            [z, p, sigma, lam],
            [H],
            ["x", "p", "lam:f", "lam:g"],
            ["triu:hess:gamma:x:x"],
        ),
        "ipopt": _IPOPT,
    }
    return BufferedFunction(
        ca.nlpsol("least_energy", "ipopt", {"x": z, "p": p, "f": value, "g": rows}, options)
    )


def _contacts(scene: Scene) -> tuple[Array, tuple[type[RodTerm], ...]]:
    """Return the parameters (K, 17) of the obstacles in contact, and the classes of their terms."""
    if not has_complementarity(scene):
        return convex_parameters([]), ()
    from octoplan.model.extensions.contact.effects import bodies_of
    from octoplan.model.extensions.contact.term import ContactTerm

    return bodies_of(scene), (ContactTerm,)
