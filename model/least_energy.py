"""The equilibrium as least potential energy, under rows that hold lengths and gaps; by ipopt.

    minimise    sum h b_i (W(v_i) + sum T |u_c'|(v_i)) - work of dead loads + sum e_j^2 / 2 c_j
    subject to  pose_{k+1} = F(pose_k, v_k) from the clamped base on,
                length_j - e_j <= what the winch leaves, of each tendon that a winch holds,
                gap(u_k) >= 0 at the nodes, of each obstacle,

over poses at the nodes, strains at the Gauss stages of the elements between them, and by how much
tendons of compliance c_j stretch. Its local minima are the stable equilibria. Its multipliers are
the tensions of tendons that are held by length, 0 of slack ones, and the forces of contact.

What has no potential (the paper's tangent, followers, currents, friction of tendons) is held as
dead generalised forces on the strains: those which the equations of equilibrium lack at the minimum
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
from model.effects import Current, Friction, NeoHookean, TipLoad
from model.loads import beyond, contacts, levers
from model.machine.buffered import Buffered
from model.obstacles import numbers_of
from model.obstacles.base import SIZE, with_gradient
from model.paths import Array
from model.progress import logged
from model.rotations import half_turn, unit_matrix
from model.scene import Scene
from model.stations import base_pose, stations, tendon_paths
from model.transcription.collocation import gauss, rotation_vectors
from model.transcription.element import Form, element, run
from model.transcription.kernel import Kernel
from model.transcription.layout import POSE, Layout, layout
from model.transcription.system import System
from model.transcription.terms import Equations, Term
from model.winches import Winches


def body_energy(law: EnergySection) -> Kernel:
    """Return the kernel of a stage's energy: strains; weight [m], numbers of the body -> [N m]."""
    v, c = ca.SX.sym("v", size(law)), ca.SX.sym("c", 1 + body_size(law))
    energy = law.energy(less_rest(law, v, c[1:]), c[1:5])
    return Kernel("body_energy", v, c, c[0] * energy)


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
    whole = element(Form(law, m, loaded=False))
    return Kernel("kinematics", whole.y, whole.c, whole.r[-POSE:])


def node_gap() -> Kernel:
    """Return the kernel of the gap at a node: u; the obstacle's numbers, the arm's radius."""
    u, c = ca.SX.sym("u", 3), ca.SX.sym("c", SIZE + 1)
    distance, _ = with_gradient()(u, c[:SIZE])
    return Kernel("node_gap", u, c, distance - c[SIZE])


LOG = logging.getLogger(__name__)
STAGES = 3
_IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-9,
    "constr_viol_tol": 1e-10,
    "max_iter": 100,
    "bound_relax_factor": 0.0,
    "mu_strategy": "adaptive",
}
# What has no potential is found anew so often, until no frame turns by more than this.
_ROUNDS, _STAYS = 12, 1e-3


@dataclass(frozen=True, eq=False)
class Minimum:
    """An equilibrium: a local minimum of the energy.

    Attributes
    ----------
    x : (n,)
        Scaled unknowns.
    tensions : (n_tendons,)
        Those that are held, and the multipliers of lengths [N].
    forces : (N, K)
        Of each of K obstacles on each node but the base [N], 0 or above.
    lacking : (N stages, strains)
        Generalised forces that have no potential, of moments and forces.
    """

    x: Array
    tensions: Array
    forces: Array
    lacking: Array


class LeastEnergy:
    """The program of an arm in a scene on a mesh.

    Attributes
    ----------
    system : System
        The equations of equilibrium on the same mesh.
    radii : (N,)
        Of the body at the nodes but the base [m], with which gaps are taken.
    """

    def __init__(self, system: System) -> None:
        self.system, arm, scene, mesh = system, system.arm, system.scene, system.mesh
        own = system.of.form
        law = own.law if isinstance(own.law, EnergySection) else _with_energy(own.law)
        form, m = Form(law, own.stages, loaded=False), own.stages
        self.of = of = layout(form, system.of.ends, mesh.steps, system.of.levers)
        self._K = len(contacts(scene))
        self.conservative = law == own.law and not _has_none(scene)
        h, L = np.diff(mesh.s), arm.length
        at = stations(arm, system.s, np.repeat(mesh.active, m))
        stage, tendon = of.crossings
        weights = np.outer(h, gauss(m).b).ravel()
        self._weights, self._tendon = weights[stage], tendon
        self._paths = tendon_paths(arm, at, stage, tendon)
        self._body = np.vstack([weights, body_numbers(arm, scene, at)])
        dead = beyond(arm, scene, system.s, np.repeat(mesh.s[1:], m)).reshape(3, mesh.steps, m)
        self._dead, self._levers = (
            dead.transpose(2, 0, 1).reshape(-1, mesh.steps),
            levers(scene)[1].T,
        )
        self._h = h[None]
        self._bodies = (
            np.tile(numbers_of([c.obstacle for c in contacts(scene)]).T, mesh.steps)
            if self._K
            else None
        )
        self.radii = np.asarray(arm.outer_radius(mesh.s[1:])[0])
        bends = 2 + law.torsion
        self._x_unit = np.ones(of.n_states)
        self._x_unit[of.nodes[:, 4:]] = L
        self._x_unit[of.stages[:, :bends]] = 1 / L
        radius = float(arm.radius.evaluate(np.zeros(1), L)[0][0])
        self._unit = float(arm.material.E * np.pi * radius**4 / 4) / L
        self._g_unit = np.ones(POSE * mesh.steps + of.n_tendons + mesh.steps * self._K)
        self._g_unit[: POSE * mesh.steps].reshape(-1, POSE)[:, 4:] = L
        self._g_unit[POSE * mesh.steps :] = L

    @property
    def force_unit(self) -> float:
        """What bends the arm, E J / L^2 of its base [N]."""
        return self._unit / self.system.arm.length

    def at_rest(self) -> Minimum:
        """Return the arm without tensions and loads, to begin with."""
        law, v = self.of.form.law, np.zeros((self.system.s.size, self.of.form.strains))
        i = 2 + law.torsion
        v[:, i : i + 1] = law.along_at_rest
        if law.curved:
            v[:, i - 2 : i] = self._body[-2:].T
        return self.at(v, np.zeros(self.of.n_tendons))

    def near(self, tensions: Array, strains: Array) -> Minimum:
        """Return where to begin near strains of the equations' law (N stages, strains)."""
        law, own = self.of.form.law, self.system.of.form.law
        v = strains if law == own else strains_of(law, reported(own, strains))
        return self.at(v, tensions)

    def at(self, v: Array, tensions: Array) -> Minimum:
        """Return where to begin at strains of the energy's law (N stages, strains)."""
        x = np.zeros(self.of.n_states)
        x[self.of.stages], x[self.of.nodes] = v, self.system.marched(self._of_system(v))
        forces = np.zeros((self.system.mesh.steps, self._K))
        return Minimum(np.append(x / self._x_unit, 0 * tensions), tensions, forces, 0 * v)

    def strains(self, here: Minimum) -> Array:
        """Return the strains of the equations' law (N stages, strains)."""
        return self._of_system((here.x[: self.of.n_states] * self._x_unit)[self.of.stages])

    def _of_system(self, v: Array) -> Array:
        law, own = self.of.form.law, self.system.of.form.law
        return v if law == own else strains_of(own, reported(law, v))

    def states(self, here: Minimum, load: float = 1.0) -> Array:
        """Return the states of the equations of equilibrium (n_states,)."""
        return self.system.start(here.tensions, self.strains(here), load, here.forces)

    def lengths(self, here: Minimum) -> Array:
        """Return the lengths of the tendons (n_tendons,) [m]."""
        x = self.system.x(here.tensions, 1.0, self.states(here))
        return self.system.lengths(x)

    def nodes(self, here: Minimum) -> Array:
        """Return the poses at the nodes (N + 1, 7)."""
        return (here.x[: self.of.n_states] * self._x_unit)[self.of.nodes]

    def _radii(self, near: Minimum) -> Array:
        """Return the larger radii (N,) of both sides of the nodes but the base [m]."""
        law = self.of.form.law
        if not self.system.scene.has(NeoHookean):
            return self.radii
        v, method = (near.x[: self.of.n_states] * self._x_unit)[self.of.stages], gauss(STAGES)
        stretch = strain_kinematics(law, v)[1][:, 0].reshape(self.system.mesh.steps, -1)
        before, beyond = stretch @ method.at(1.0), np.roll(stretch @ method.at(0.0), -1)
        beyond[-1] = before[-1]
        return np.asarray(self.radii / np.sqrt(np.minimum(before, beyond)))

    def least(
        self,
        near: Minimum,
        tensions: Array,
        load: float = 1.0,
        winches: Winches | None = None,
        rounds: int = _ROUNDS,
    ) -> Minimum | None:
        """Return the least energy near a start; None where none is found.

        Under `tensions` (n_tendons,) of the tendons that no winch holds, and a load factor. What
        has no potential is found anew in so many `rounds` at most.
        """
        if self.conservative:
            return self._minimum(near, tensions, load, winches)
        here = near
        for _ in range(rounds):
            found = self._minimum(here, tensions, load, winches)
            if found is None:
                return None
            states = self.states(found, load)
            off = self.system.residual(self.system.x(found.tensions, load, states))
            turned = np.abs(self.nodes(found)[:, :4] - self.nodes(here)[:, :4]).max()
            here = replace(found, lacking=found.lacking + off[self.system.of.stages])
            if turned < _STAYS:
                return here
        return here

    def _minimum(
        self, near: Minimum, tensions: Array, load: float, winches: Winches | None
    ) -> Minimum | None:
        of, L, K, N = self.of, self.system.arm.length, self._K, self.system.mesh.steps
        nT, first = of.n_tendons, POSE * N
        stretch = np.zeros(nT) if winches is None else winches.stretch
        stiff = np.divide(1.0, stretch, out=np.zeros(nT), where=stretch > 0)
        pulls = (self._weights * tensions[self._tendon])[None]
        numbers = [
            self._body,
            np.vstack([self._paths, pulls]),
            np.vstack([self._h, load * self._dead]),
        ]
        if self._levers.size:
            numbers.append(self._levers * np.repeat([1.0, load], 3)[:, None])
        rows = [self._h, np.vstack([self._paths, self._weights[None]])]
        if self._bodies is not None:
            rows.append(np.vstack([self._bodies, np.repeat(self._radii(near), K)]))
        forces = np.zeros(of.n_states)
        forces[of.stages] = near.lacking * self._body[:1].T
        parts = [
            self._x_unit,
            np.array([1 / self._unit]),
            self._g_unit,
            stiff,
            forces,
            *(a.ravel("F") for a in (*numbers, *rows)),
        ]
        low, high = np.full(of.n_states + nT, -np.inf), np.full(of.n_states + nT, np.inf)
        low[:POSE] = high[:POSE] = base_pose(self.system.arm) / self._x_unit[:POSE]
        low[of.n_states :], high[of.n_states :] = 0.0, np.where(stiff > 0, np.inf, 0.0)
        most = (
            np.full(nT, np.inf)
            if winches is None
            else np.where(winches.held, winches.lengths / L, np.inf)
        )
        g_low = np.concatenate([np.zeros(first), np.full(nT, -np.inf), np.zeros(N * K)])
        g_high = np.concatenate([np.zeros(first), most, np.full(N * K, np.inf)])
        solver = _solver(of, K)
        bounds = low, high, g_low, g_high
        with logged(LOG):
            found = solver(
                near.x, np.concatenate(parts), *bounds, np.zeros(low.size), np.zeros(g_low.size)
            )
        x, lam = found[0].ravel(), found[4].ravel()
        stats = solver.stats()
        LOG.debug(
            "least energy: %s after %d iterations", stats["return_status"], stats["iter_count"]
        )
        if stats["return_status"] not in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
            return None
        force = self.force_unit
        pulled = np.maximum(force * lam[first : first + nT], 0.0)
        pressed = np.maximum(-force * lam[first + nT :], 0.0).reshape(N, K)
        return Minimum(x, tensions + pulled, pressed, near.lacking)


def _with_energy(law: CrossSection) -> EnergySection:
    return ExactSection(law.extension, law.torsion, law.shear, law.curved)


def _has_none(scene: Scene) -> bool:
    """Return whether something in a scene has no potential."""
    tip = scene.find(TipLoad)
    turns = tip is not None and (tip.follower or any(tip.moment))
    return turns or scene.has(Current) or scene.has(Friction)


@lru_cache(maxsize=32)
def _solver(of: Layout, obstacles: int) -> Buffered:
    """Return ipopt for a structure, numbers left open.

    It takes x0, p, lbx, ubx, lbg, ubg, lam_x0, lam_g0. Unknowns are scaled
    states, then what tendons stretch over the arm's length.
    """
    law, m, N, n, nT = of.form.law, of.form.stages, of.elements, of.n_states, of.n_tendons
    assert isinstance(law, EnergySection)
    nodes, v, (stage, tendon) = of.nodes, of.stages.T, of.crossings
    first = POSE * N
    terms = [
        (body_energy(law), v),
        (run(law), v[:, stage]),
        (dead_loads(law, m), np.vstack([nodes[:-1, :4].T, of.inside])),
        (off_midline(), nodes[list(of.levers), :4].T),
    ]
    f = Equations(n, 1, [Term(k, y, np.zeros((1, y.shape[1]), np.int64)) for k, y in terms])
    poses = np.arange(first).reshape(N, POSE).T
    gaps = first + nT + np.arange(N * obstacles)[None]
    g = Equations(
        n,
        first + nT + N * obstacles,
        [
            Term(kinematics(law, m), np.vstack([nodes[:-1].T, of.inside, nodes[1:].T]), poses),
            Term(run(law), v[:, stage], first + tendon[None]),
            Term(node_gap(), np.repeat(nodes[1:, 4:], obstacles, axis=0).T, gaps),
        ],
    )
    sizes = (n, 1, g.n_g, nT, n, f.n_p, g.n_p)
    z, p = ca.MX.sym("z", n + nT), ca.MX.sym("p", sum(sizes))
    unit, f_unit, g_unit, stiff, dead, pf, pg = ca.vertsplit(p, np.cumsum([0, *sizes]).tolist())
    L = g_unit[first]
    x, e = z[:n] * unit, z[n:] * L
    value = f_unit * (f.value(x, pf) + ca.dot(stiff, e**2) / 2 + ca.dot(dead, x))
    longer = ca.vertcat(ca.MX.zeros(first), e, ca.MX.zeros(N * obstacles))
    rows = (g.value(x, pg) - longer) / g_unit
    (by_f, at_f), (by_g, at_g) = f.jacobian, g.jacobian
    sigma, lam = ca.MX.sym("sigma"), ca.MX.sym("lam", g.n_g)

    def scaled(values: ca.MX, places: ca.Sparsity, by_row: ca.MX, by_column: ca.MX) -> ca.MX:
        i, j = places.get_triplet()
        return ca.MX(places, values * ca.vec(by_row[i]) * ca.vec(by_column[j]))

    gradient = scaled(by_f(x, pf), at_f, f_unit, unit).T + f_unit * dead * unit
    gradient = ca.densify(ca.vertcat(gradient, f_unit * stiff * e * L))
    places = ca.Sparsity.triplet(g.n_g, nT, list(range(first, first + nT)), list(range(nT)))
    J = ca.horzcat(scaled(by_g(x, pg), at_g, 1 / g_unit, unit), -ca.DM(places, 1.0))
    (of_f, in_f), (of_g, in_g) = f.hessian, g.hessian
    H = scaled(of_f(x, pf, sigma * f_unit), in_f, unit, unit)
    H += scaled(of_g(x, pg, lam / g_unit), in_g, unit, unit)
    H = ca.triu(ca.diagcat(H, ca.diag(sigma * f_unit * stiff * L**2)))
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
        "ipopt": _IPOPT,
    }
    return Buffered(
        ca.nlpsol("least_energy", "ipopt", {"x": z, "p": p, "f": value, "g": rows}, options)
    )
