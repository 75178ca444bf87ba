"""The equilibrium of one arm in one scene on one mesh: its equations as numbers.

States S are an arm's unknowns but for tensions and load factor; see
octoplan.model.rod.layout.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csr_array

from octoplan.model.arm import Arm
from octoplan.model.cross_section import cross_section_of
from octoplan.model.cross_section.sections import Sections, kinematics
from octoplan.model.effects import Current, Friction, NeoHookean, TipLoad
from octoplan.model.extensions.contact.effects import contacts
from octoplan.model.loads import growth, is_loaded, levers, places
from octoplan.model.mesh import Mesh, graded
from octoplan.model.paths import Array
from octoplan.model.rod.collocation import gauss
from octoplan.model.rod.element import Form, element
from octoplan.model.rod.layout import POSE, layout
from octoplan.model.rod.numbers import numbers
from octoplan.model.rotations import cross
from octoplan.model.scene import Scene
from octoplan.model.support.machine.compiled import kernel
from octoplan.model.support.machine.functions import BatchFunction, BufferedFunction, cached

# Kernels of what acts at nodes, by which moments and forces differ on both sides of these.
_AT_NODES = ("lever", "touch")


class DiscreteRod:
    """The equations of an arm in a scene on a mesh.

    Attributes
    ----------
    mesh : Mesh
    layout : Layout
    p : (n_p,)
        Numbers of the equations.
    length_numbers : (n,)
        Numbers of the tendons' lengths.
    s : (N stages,)
        Arc lengths of the stages [m].
    sections : Sections
        The cross-sections there; tendons cross them in the order of the layout's crossings.
    units : (strains,)
        Sizes of strains below which these are small: 1 / L of curvatures [1/m], 1 of others.
    """

    def __init__(
        self,
        arm: Arm,
        scene: Scene,
        mesh: Mesh,
        stages: int,
        loaded: bool = True,
        machine_code: bool = False,
        pressed: bool = False,
    ) -> None:
        self.arm, self.scene, self.mesh = arm, scene, mesh
        tip, touched = scene.find(TipLoad), contacts(scene) if loaded else ()
        form = Form(
            cross_section_of(scene, arm.is_curved, twisted=loaded),
            stages,
            loaded,
            scene.has(Current),
            tip is not None and tip.follower,
            scene.has(Friction),
            machine_code,
            len(touched),
            pressed,
            any(contact.friction for contact in touched),
        )
        at = [mesh.node(section.at) for section in arm.sections]
        off = tuple(mesh.node(s) for s in levers(scene)[0].tolist())
        self.layout = layout(form, tuple(at[i] for i, _ in arm.tendons), mesh.steps, off)
        self.s, weights, active = mesh.points(stages)
        self.sections = Sections(arm, scene, form.law, self.s, active, machine_code)
        curvatures = np.arange(form.strains) < 2 + form.law.torsion
        self.units = np.where(curvatures, 1 / arm.length, 1.0)
        self.p, self.length_numbers = numbers(arm, scene, mesh, self.layout, self.sections, weights)

    def __reduce__(self) -> tuple[Any, ...]:
        form = self.layout.form
        structure = form.stages, form.loaded, form.machine_code, form.pressed
        return _restored, (self.arm, self.scene, self.mesh, *structure, self.p)

    def __copy__(self) -> DiscreteRod:
        result = object.__new__(DiscreteRod)
        vars(result).update(vars(self), p=self.p.copy())
        return result

    @property
    def base(self) -> Array:
        """The pose (7,) that the base is clamped at: the first of the numbers."""
        return self.p[:POSE]

    def x(self, tensions: Array, load: float, states: Array) -> Array:
        """Return all unknowns (..., n_x): tensions (..., n_tendons), load factor, states."""
        factor = [load] if tensions.ndim == 1 else np.full((len(tensions), 1), load)
        return np.concatenate([tensions, factor, states], axis=-1)

    def residual(self, x: Array) -> Array:
        """Return the residuals of equilibrium (..., n_states)."""
        return np.asarray(self.layout.equations.value(x, self.p))

    def lengths(self, x: Array) -> Array:
        """Return the length of each tendon (n_tendons,) [m]."""
        return np.asarray(self.layout.lengths.value(x, self.length_numbers))

    def length_jacobian(self, x: Array) -> Array:
        """Return the derivatives of the lengths against the states (n_tendons, n_states)."""
        of, lengths = self.layout, self.layout.lengths
        nonzeros = lengths.jacobian(x, self.length_numbers)
        whole = csr_array((nonzeros, lengths.jacobian.triplet), (of.n_tendons, of.n_x + 1))
        return np.asarray(whole.toarray()[:, of.first : -1])

    def by_wrench(self, x: Array, node: int) -> Array:
        """Return how residuals change with a dead force and moment at a node (n_states, 6).

        They enter as numbers of the elements on its base side and of the node beyond the last one.
        """
        steps, numbers_of = self.mesh.steps, self.layout.equations.numbers_of
        change = np.zeros((self.p.size, 6))
        elements = change[numbers_of("element")].reshape(steps, -1, 6)
        elements[:node, 1:4, :3] = np.eye(3)
        moment = elements[node - 1, 4:7] if node < steps else change[numbers_of("tip")][6:9]
        moment[:, 3:] = np.eye(3)
        values = [self.layout.equations.value(x, self.p + each) for each in change.T]
        return np.stack(values, axis=1) - self.residual(x)[:, None]

    def poses(self, states: Array) -> Array:
        """Return the poses at the nodes (N + 1, 7), from base to tip."""
        return states[self.layout.nodes[:, :POSE]]

    def wrenches_beyond(self, x: Array) -> Array:
        """Return moments, and forces that are unknown, on the tip side of the nodes (N + 1, w)."""
        states, of = x[self.layout.first :].copy(), self.layout
        for term in of.equations.terms:
            if term.kernel.name in _AT_NODES:
                # Rows stand where the states do whose balance they are part of.
                np.add.at(states, term.rows, self.rows_of(term.kernel.name, x).T)
        return states[of.nodes[:, POSE : POSE + of.form.wrench]]

    def rows_of(self, name: str, x: Array) -> Array:
        """Return the residuals (N, n_r) of all that a kernel is repeated for, by its name."""
        (term,) = [term for term in self.layout.equations.terms if term.kernel.name == name]
        c = self.p[self.layout.equations.numbers_of(name)].reshape(term.count, -1)
        return cached(BatchFunction, term.kernel.value, self.layout.form.machine_code)(
            x[term.unknowns].T, c
        )[0]

    def stretch_beside(self, strains: Array) -> tuple[Array, Array]:
        """Return the stretch (N,) on the base and on the tip side of the nodes but the base.

        By strains (N stages, strains).
        """
        method = gauss(self.layout.form.stages)
        stretch = kinematics(self.layout.form.law, strains)[1][:, 0].reshape(self.mesh.steps, -1)
        before, beyond = stretch @ method.at(1.0), np.roll(stretch @ method.at(0.0), -1)
        beyond[-1] = before[-1]
        return before, beyond

    def outer_radii(self, strains: Array) -> Array:
        """Return the larger of the arm's outer radii (N,) on both sides of the nodes but the base.

        Strains (N stages, strains) may jump there, and with them the radius of a body that keeps
        its volume, which swells by lambda^(-1/2) where it is shortened to lambda [m].
        """
        radii = self.arm.outer_radius(self.mesh.s[1:])[0]
        if not self.scene.has(NeoHookean):
            return radii
        return np.asarray(radii / np.sqrt(np.minimum(*self.stretch_beside(strains))))

    def marched(self, strains: Array) -> Array:
        """Return the poses at the nodes (N + 1, 7) of strains at the stages (N stages, strains)."""
        call, base = cached(_march, self.layout.form, self.mesh.steps), self.p[:POSE]
        (result,) = call(base, strains.ravel(), np.diff(self.mesh.s))
        return np.vstack([base, result])

    def start(
        self, tensions: Array, strains: Array, load: float = 0.0, pressed: Array | None = None
    ) -> Array:
        """Return the states (..., n_states) of strains at the stages (..., N stages, strains).

        Of an arm or of many, tensions (..., n_tendons). Poses follow from the base on, forces and
        moments from the tip on; with the forces `pressed` (N, contacts) of obstacles on the nodes
        but the base, if given [N].
        """
        of, m = self.layout, self.layout.form.stages
        x = self.x(tensions, load, np.zeros((*tensions.shape[:-1], of.n_states)))
        states = x[..., of.first :]
        states[..., of.stages] = strains
        by_arm = strains.reshape(-1, *strains.shape[-2:])
        poses = np.array([self.marched(each) for each in by_arm])
        states[..., of.nodes[:, :POSE]] = poses.reshape(*tensions.shape[:-1], *poses.shape[1:])
        if pressed is not None:
            states[..., of.touches[1:, :, 0]] = pressed
        if of.form.friction:
            slope = np.arange(1, m) * gauss(m).c[:, None] ** np.arange(m - 1)
            by_stage = strains.reshape(*tensions.shape[:-1], self.mesh.steps, m, -1)
            rates = slope @ gauss(m).powers[1:] @ by_stage / np.diff(self.mesh.s)[:, None, None]
            states[..., of.rates] = rates.reshape(strains.shape)
        if not (of.form.loaded or of.form.friction):
            return states
        missing = -self.residual(x)
        states[..., of.turned] = np.cumsum(missing[..., of.turned], axis=-2)
        moments, forces, u = (of.nodes[:, k : k + 3] for k in (POSE, POSE + 3, 4))
        if of.form.moving:
            states[..., forces] = _from_tip(missing[..., forces])
            # The residuals are those without forces beyond the elements.
            along, beyond = np.diff(states[..., u], axis=-2), states[..., forces[1:]]
            missing[..., moments[:-1]] += cross(along, beyond)
        if of.form.loaded:
            states[..., moments] = _from_tip(missing[..., moments])
        return states


def _from_tip(steps: Array) -> Array:
    """Return the sums (..., N + 1, 3) from the tip on of what is added at each node."""
    return np.asarray(np.cumsum(steps[..., ::-1, :], axis=-2)[..., ::-1, :])


def _restored(*value: Any) -> DiscreteRod:
    """Return equations with numbers of their own: the last that is given."""
    result = DiscreteRod(*value[:-1])
    result.p = value[-1]
    return result


@lru_cache(maxsize=32)
def system(
    arm: Arm,
    scene: Scene,
    stages: int,
    refinement: int,
    at: tuple[float, ...] = (),
    loaded: bool = True,
    machine_code: bool = False,
    steps_per_unit: float = 2.0,
) -> DiscreteRod:
    """Return the equations on a mesh of a refinement that has the arc lengths `at` as nodes.

    Where nothing is `loaded`, forces and moments are left out; with `machine_code` the kernels are
    compiled. Of `steps_per_unit` see octoplan.model.mesh.graded.
    """
    rate = partial(growth, arm, scene) if is_loaded(scene) else None
    nodes = *at, *places(arm, scene)
    mesh = graded(arm, refinement, nodes, rate, steps_per_unit=steps_per_unit)
    return DiscreteRod(arm, scene, mesh, stages, loaded, machine_code)


def _march(form: Form, N: int) -> BufferedFunction:
    """Return (pose, strains of each of N elements, h (1, N)) -> pose at the end of each."""
    values = cached(element, replace(form, friction=False))
    g, v, h = ca.SX.sym("g", POSE), ca.SX.sym("v", form.stages * form.strains), ca.SX.sym("h")
    none = ca.SX.zeros(form.wrench)
    y = ca.vertcat(ca.SX.zeros(int(form.loaded)), g, none, v, ca.SX.zeros(POSE), none)
    numbers_of = ca.vertcat(h, ca.SX.zeros(values.c.numel() - 1))
    after = -values.value(y, numbers_of)[-POSE:]
    step = ca.Function("march", [g, v, h], [after], {"cse": True})
    return BufferedFunction(kernel(step, form.machine_code).mapaccum(N))
