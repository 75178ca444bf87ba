"""The equilibrium as least potential energy, under rows that hold lengths and gaps; by ipopt.

    minimise    sum h b_i (W(v_i) + sum T |u_c'|(v_i)) - work of dead loads + sum e_j^2 / 2 c_j
    subject to  pose_{k+1} = F(pose_k, v_k) from the clamped base on,
                length_j - e_j <= what the winch leaves, of each tendon that a winch holds,
                gap(u_k) >= 0 at the nodes, of each obstacle,

over poses at the nodes, strains at the Gauss stages of the elements between them, and by how much
tendons of compliance c_j stretch. Its local minima are the stable equilibria. Its multipliers are
the tensions of tendons that are held by length, 0 of slack ones, and the forces of contact.

Lengths are in units of the arm's, forces in those that bend it, E J / L^2 of its base.

Nonconservative forces (the paper's tangent, followers, currents, friction of tendons) are held as
dead generalised forces on the strains: the residuals of the equations of equilibrium at the minimum
before. The minimum is sought again until these stay.

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

from model.cross_section.energy import EnergySection, ExactSection
from model.cross_section.law import CrossSection, body_size, less_rest, reported, size, strains_of
from model.cross_section.law import kinematics as strain_kinematics
from model.cross_section.sections import body_numbers
from model.effects import NeoHookean
from model.loads import beyond, contacts, is_conservative, levers
from model.machine.buffered import Buffered
from model.machine.compiled import built
from model.obstacles import numbers_of
from model.obstacles.base import SIZE, signed_distance
from model.paths import Array
from model.progress import logged
from model.rotations import half_turn, unit_matrix
from model.stations import base_pose, stations, tendon_paths
from model.transcription.collocation import gauss, rotation_vectors
from model.transcription.element import Form, element, run
from model.transcription.equations import Equations, Kernel, Sum, Term
from model.transcription.layout import POSE, Layout, layout
from model.transcription.system import System
from model.winches import Winches


def body_energy(law: EnergySection) -> Kernel:
    """Return the kernel of a stage's energy less the work of dead generalised forces.

    Strains; weight, numbers of the body, less the forces.
    """
    n = body_size(law)
    v, weight, body = ca.SX.sym("v", size(law)), ca.SX.sym("weight"), ca.SX.sym("body", n)
    forces = ca.SX.sym("forces", size(law))
    energy = law.energy(less_rest(law, v, body), body[:4]) + ca.dot(forces, v)
    return Kernel("body_energy", v, ca.vertcat(weight, body, forces), weight * energy)


def dead_loads(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of less the work of dead loads on an element.

    q, strains; h, the resultants of dead forces beyond the stages (3, m) -> - integral of F . u'.
    """
    q, v = ca.SX.sym("q", 4), ca.SX.sym("v", size(law), m)
    h, dead = ca.SX.sym("h"), ca.SX.sym("dead", 3, m)
    twists = [law.twist(at) for at in ca.horzsplit(v)]
    turns = rotation_vectors([kappa for kappa, _ in twists], h)[:-1]
    along = [unit_matrix(half_turn(turn)) @ nu for turn, (_, nu) in zip(turns, twists, strict=True)]
    local = ca.horzsplit(unit_matrix(q).T @ dead)
    work = ca.vertcat(*(ca.dot(f, t) for f, t in zip(local, along, strict=True)))
    value = -h * ca.dot(ca.DM(gauss(m).b), work)
    return Kernel("dead_loads", ca.vertcat(q, ca.vec(v)), ca.vertcat(h, ca.vec(dead)), value)


def off_midline() -> Kernel:
    """Return the kernel of less the work of a dead force off the midline: q; offset, force."""
    q, c = ca.SX.sym("q", 4), ca.SX.sym("c", 6)
    return Kernel("off_midline", q, c, -ca.dot(unit_matrix(q) @ c[:3], c[3:]))


def kinematics(law: CrossSection, m: int) -> Kernel:
    """Return the kernel of an element's kinematics: the residuals of the pose at its end."""
    whole = built(element, Form(law, m, loaded=False))
    return Kernel("kinematics", whole.y, whole.c, whole.r[-POSE:])


def node_gap() -> Kernel:
    """Return the kernel of the gap at a node: u; the obstacle's numbers, the arm's radius, L [m].

    The obstacle's are in metres, what else there is in units of L.
    """
    u, c = ca.SX.sym("u", 3), ca.SX.sym("c", SIZE + 2)
    distance, _ = signed_distance()(c[SIZE + 1] * u, c[:SIZE])
    return Kernel("node_gap", u, c, distance / c[SIZE + 1] - c[SIZE])


def stretched() -> Kernel:
    """Return the kernel of a tendon's energy: by how much it is longer; its stiffness."""
    e, c = ca.SX.sym("e"), ca.SX.sym("c")
    return Kernel("stretched", e, c, c * e**2 / 2)


def longer() -> Kernel:
    """Return the kernel of what a tendon's stretch adds to its row: less the stretch."""
    e = ca.SX.sym("e")
    return Kernel("longer", e, ca.SX(0, 1), -e)


LOG = logging.getLogger(__name__)

# Residuals that are left, in the units of the program: of what is a solution, and of a guess.
SHARP, ROUGH = 1e-9, 1e-4
_IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "max_iter": 100,
    "bound_relax_factor": 0.0,
    "mu_strategy": "adaptive",
}
# Nonconservative forces are updated so often, until no frame turns by more than this.
ROUNDS, _STAYS = 12, 1e-3


@dataclass(frozen=True, eq=False)
class Minimum:
    """An equilibrium: a local minimum of the energy.

    Attributes
    ----------
    x : (n,)
        Unknowns in the units of the program: states, then what tendons stretch by.
    tensions : (n_tendons,)
        Those that are held, and the multipliers of lengths [N].
    forces : (N, K)
        Of each of K obstacles on each node but the base [N], 0 or above.
    nonconservative : (N stages, strains)
        Generalised forces that have no potential, less moments and forces [N m], [N].
    """

    x: Array
    tensions: Array
    forces: Array
    nonconservative: Array


class LeastEnergy:
    """The program of an arm in a scene on a mesh.

    Attributes
    ----------
    system : System
        The equations of equilibrium on the same mesh.
    of : Layout
        Of the states of the program, poses and strains.
    conservative : bool
        Whether all forces have a potential.
    force_unit : float
        What bends the arm, E J / L^2 of its base [N].
    """

    def __init__(self, system: System) -> None:
        self.system, arm, scene, mesh = system, system.arm, system.scene, system.mesh
        form, m, L = system.of.form, system.of.form.stages, arm.length
        law = form.law if isinstance(form.law, EnergySection) else _with_energy(form.law)
        self.of = of = layout(
            Form(law, m, loaded=False), system.of.ends, mesh.steps, system.of.levers
        )
        self.conservative = law == form.law and is_conservative(scene)
        radius = float(arm.radius.evaluate(np.zeros(1), L)[0][0])
        self.force_unit = F = float(arm.material.E * np.pi * radius**4 / 4) / L**2
        self._unit = np.ones(of.n_states)
        self._unit[of.nodes[:, 4:]] = L
        self._unit[of.stages[:, : 2 + law.torsion]] = 1 / L
        self._bodies = [contact.obstacle for contact in contacts(scene)]
        self._radii = np.asarray(arm.outer_radius(mesh.s[1:])[0])
        at = stations(arm, system.s, np.repeat(mesh.active, m))
        self._stage, self._tendon = of.crossings
        self._h = np.diff(mesh.s)[None] / L
        self._weights = np.outer(self._h, gauss(m).b).ravel()
        stiff = [F, F * L**2, F * L**2, F, *[1 / L] * (2 * law.curved)]
        self._body = body_numbers(arm, scene, at) / np.array(stiff)[:, None]
        self._paths = tendon_paths(arm, at, self._stage, self._tendon) / np.array(
            [[L], [L], [1], [1]]
        )
        dead = beyond(arm, scene, system.s, np.repeat(mesh.s[1:], m)).reshape(3, mesh.steps, m)
        self._dead = dead.transpose(2, 0, 1).reshape(-1, mesh.steps) / F
        self._levers = levers(scene)[1].T / np.repeat([L, F], 3)[:, None]

    def at_rest(self) -> Minimum:
        """Return the arm without tensions and loads, to begin with."""
        law, v = self.of.form.law, np.zeros((self.system.s.size, self.of.form.strains))
        i = 2 + law.torsion
        v[:, i : i + 1] = law.along_at_rest
        if law.curved:
            v[:, i - 2 : i] = self._body[-2:].T / self.system.arm.length
        return self._at(v, np.zeros(self.of.n_tendons))

    def near(self, tensions: Array, strains: Array) -> Minimum:
        """Return where to begin near strains of the equations' law (N stages, strains)."""
        law, values = self.of.form.law, self.system.of.form.law
        return self._at(
            strains if law == values else strains_of(law, reported(values, strains)), tensions
        )

    def _at(self, v: Array, tensions: Array) -> Minimum:
        """Return where to begin at strains of the energy's law (N stages, strains)."""
        x = np.zeros(self.of.n_states)
        x[self.of.stages], x[self.of.nodes] = v, self.system.marched(self._of_system(v))
        forces = np.zeros((self.system.mesh.steps, len(self._bodies)))
        return Minimum(np.append(x / self._unit, 0 * tensions), tensions, forces, 0 * v)

    def _states(self, point: Minimum) -> Array:
        """Return the states of the program (n_states,) in SI units."""
        return point.x[: self.of.n_states] * self._unit

    def strains(self, point: Minimum) -> Array:
        """Return the strains of the equations' law (N stages, strains)."""
        return self._of_system(self._states(point)[self.of.stages])

    def _of_system(self, v: Array) -> Array:
        law, values = self.of.form.law, self.system.of.form.law
        return v if law == values else strains_of(values, reported(law, v))

    def states(self, point: Minimum, load: float = 1.0) -> Array:
        """Return the states of the equations of equilibrium (n_states,)."""
        return self.system.start(point.tensions, self.strains(point), load, point.forces)

    def lengths(self, point: Minimum) -> Array:
        """Return the lengths of the tendons (n_tendons,) [m]."""
        return self.system.lengths(self.system.x(point.tensions, 1.0, self.states(point)))

    def nodes(self, point: Minimum) -> Array:
        """Return the poses at the nodes (N + 1, 7)."""
        return self._states(point)[self.of.nodes]

    def _swollen(self, near: Minimum) -> Array:
        """Return the larger radii (N,) of both sides of the nodes but the base [m]."""
        if not self.system.scene.has(NeoHookean):
            return self._radii
        v, method = self._states(near)[self.of.stages], gauss(self.of.form.stages)
        stretch = strain_kinematics(self.of.form.law, v)[1][:, 0]
        stretch = stretch.reshape(self.system.mesh.steps, -1)
        before, beyond = stretch @ method.at(1.0), np.roll(stretch @ method.at(0.0), -1)
        beyond[-1] = before[-1]
        return np.asarray(self._radii / np.sqrt(np.minimum(before, beyond)))

    def least(
        self,
        near: Minimum,
        tensions: Array,
        load: float = 1.0,
        winches: Winches | None = None,
        rounds: int = ROUNDS,
        tolerance: float = SHARP,
    ) -> Minimum | None:
        """Return the least energy near a start; None where none is found.

        Under `tensions` (n_tendons,) of the tendons that no winch holds, and a load factor.
        Nonconservative forces are updated in so many `rounds` at most; `tolerance` is SHARP or
        ROUGH.
        """
        point = near
        for _ in range(1 if self.conservative else rounds):
            after = self._minimum(point, tensions, load, winches, tolerance)
            if after is None or self.conservative:
                return after
            residual = self.system.residual(
                self.system.x(after.tensions, load, self.states(after, load))
            )
            turned = np.abs(self.nodes(after)[:, :4] - self.nodes(point)[:, :4]).max()
            forces = after.nonconservative + residual[self.system.of.stages]
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
        tolerance: float,
    ) -> Minimum | None:
        of, F, L, K = self.of, self.force_unit, self.system.arm.length, len(self._bodies)
        n, nT, poses, inf = of.n_states, of.n_tendons, POSE * of.elements, np.inf
        held = np.zeros(nT, dtype=bool) if winches is None else winches.held
        stretch = np.zeros(nT) if winches is None else winches.stretch * F / L
        stretches = stretch > 0
        forces = (near.nonconservative * self._unit[of.stages]).T / F
        energy = [
            np.vstack([self._weights, self._body, forces]),
            np.vstack([self._paths, self._weights[self._stage] * tensions[self._tendon] / F]),
            np.vstack([self._h, load * self._dead]),
            self._levers * np.repeat([1.0, load], 3)[:, None],
            np.divide(1.0, stretch, out=np.zeros(nT), where=stretches),
        ]
        rows = [self._h, np.vstack([self._paths, self._weights[self._stage]])]
        if K:
            bodies = np.tile(numbers_of(self._bodies).T, of.elements)
            radii = np.repeat(self._swollen(near) / L, K)
            rows.append(np.vstack([bodies, radii, np.full(radii.size, L)]))
        low, high = np.full(n + nT, -inf), np.full(n + nT, inf)
        low[:POSE] = high[:POSE] = base_pose(self.system.arm) / self._unit[:POSE]
        low[n:], high[n:] = 0.0, np.where(stretches, inf, 0.0)
        lengths = np.full(nT, inf) if winches is None else np.where(held, winches.lengths / L, inf)
        gaps, solver = np.zeros(of.elements * K), _solver(of, K, tolerance)
        g_low = np.concatenate([np.zeros(poses), np.full(nT, -inf), gaps])
        g_high = np.concatenate([np.zeros(poses), lengths, gaps + inf])
        p = np.concatenate([np.ravel(part, "F") for part in (*energy, *rows)])
        with logged(LOG):
            x, _, _, _, lam, _ = (
                part.ravel()
                for part in solver(
                    near.x, p, low, high, g_low, g_high, np.zeros(n + nT), np.zeros(g_low.size)
                )
            )
        stats = solver.stats()
        LOG.debug(
            "least energy: %s after %d iterations", stats["return_status"], stats["iter_count"]
        )
        if stats["return_status"] not in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
            return None
        pulled = np.maximum(F * lam[poses : poses + nT], 0.0)
        pressed = np.maximum(-F * lam[poses + nT :], 0.0).reshape(of.elements, K)
        return replace(near, x=x, tensions=tensions + pulled, forces=pressed)


def _with_energy(law: CrossSection) -> EnergySection:
    return ExactSection(law.extension, law.torsion, law.shear, law.curved)


def _energy(of: Layout) -> Equations:
    """Return the energy of a structure: of its states, then what tendons stretch by."""
    law, m, n, nodes, v = of.form.law, of.form.stages, of.n_states, of.nodes, of.stages.T
    assert isinstance(law, EnergySection)
    terms = [
        (body_energy(law), v),
        (built(run, law), v[:, of.crossings[0]]),
        (dead_loads(law, m), np.vstack([nodes[:-1, :4].T, of.inside])),
        (off_midline(), nodes[list(of.levers), :4].T),
        (stretched(), n + np.arange(of.n_tendons)[None]),
    ]
    row = [Term(kernel, y, np.zeros((1, y.shape[1]), np.int64)) for kernel, y in terms]
    return Equations(n + of.n_tendons, 1, row)


def _rows(of: Layout, obstacles: int) -> Equations:
    """Return the rows: poses at the ends of elements, lengths of tendons, gaps at nodes."""
    law, nodes, (stage, tendon) = of.form.law, of.nodes, of.crossings
    n, N, tendons = of.n_states, of.elements, np.arange(of.n_tendons)[None]
    poses = np.arange(POSE * N).reshape(N, POSE).T
    lengths, gaps = POSE * N + tendons, POSE * N + tendons.size + np.arange(N * obstacles)[None]
    places = np.vstack([nodes[:-1].T, of.inside, nodes[1:].T])
    terms = [
        Term(kinematics(law, of.form.stages), places, poses),
        Term(built(run, law), of.stages.T[:, stage], lengths[:, tendon]),
        Term(longer(), n + tendons, lengths),
        Term(node_gap(), np.repeat(nodes[1:, 4:], obstacles, axis=0).T, gaps),
    ]
    return Equations(n + tendons.size, POSE * N + tendons.size + gaps.size, terms)


@lru_cache(maxsize=32)
def _solver(of: Layout, obstacles: int, tolerance: float) -> Buffered:
    """Return ipopt for a structure, numbers left open.

    It takes x0, p, lbx, ubx, lbg, ubg, lam_x0, lam_g0; p are the numbers of energy and rows.
    """
    f, g = _energy(of), _rows(of, obstacles)
    z, p, lam = (
        ca.MX.sym(*sized) for sized in (("z", f.n_x), ("p", f.n_p + g.n_p), ("lam", g.n_g))
    )
    sigma, pf, pg = ca.MX.sym("sigma"), p[: f.n_p], p[f.n_p :]
    value, rows = f.value.function(z, pf), g.value.function(z, pg)

    def matrix(of: Sum, *value: ca.MX) -> ca.MX:
        return ca.MX(of.places, of.function(*value))

    gradient, J = ca.densify(matrix(f.jacobian, z, pf)).T, matrix(g.jacobian, z, pg)
    H = ca.triu(matrix(f.hessian, z, pf, sigma) + matrix(g.hessian, z, pg, lam))
    options: dict[str, Any] = {
        "print_time": False,
        "show_eval_warnings": False,
        "calc_lam_p": False,
        "no_nlp_grad": True,
        "error_on_fail": False,
        "grad_f": ca.Function(
            "nlp_grad_f", [z, p], [value, gradient], ["x", "p"], ["f", "grad:f:x"]
        ),
        "jac_g": ca.Function("nlp_jac_g", [z, p], [rows, J], ["x", "p"], ["g", "jac:g:x"]),
        "hess_lag": ca.Function(
            "nlp_hess_l",
            [z, p, sigma, lam],
            [H],
            ["x", "p", "lam:f", "lam:g"],
            ["triu:hess:gamma:x:x"],
        ),
        "ipopt": {**_IPOPT, "tol": tolerance, "constr_viol_tol": tolerance / 10},
    }
    return Buffered(
        ca.nlpsol("least_energy", "ipopt", {"x": z, "p": p, "f": value, "g": rows}, options)
    )
