"""The numbers that the kernels take of an arm and a scene on a mesh."""

from __future__ import annotations

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.cross_section.sections import Sections
from octoplan.model.effects import Current, Friction, TipLoad
from octoplan.model.extensions.contact.effects import bodies_of, contacts
from octoplan.model.loads import beyond, directions, levers, specific_weight
from octoplan.model.mesh import Mesh
from octoplan.model.paths import Array
from octoplan.model.rod.element import Form
from octoplan.model.rod.layout import Layout
from octoplan.model.scene import Scene
from octoplan.model.stations import base_pose, body_numbers, stations, tendon_paths

# What slip is weighted with in contact friction, over the stiffness E J / L^3 of the base.
_RESISTS = 10.0


def numbers(
    arm: Arm, scene: Scene, mesh: Mesh, of: Layout, at: Sections, weights: Array
) -> tuple[Array, Array]:
    """Return the numbers of an arm and a scene in the order of the layout's terms.

    Those of the equations of equilibrium (n_p,), and of the equations of the tendons' lengths (n,);
    with the cross-sections at the stages, and their weights in integrals along the arm (N stages,).
    """
    form = of.form
    columns = {"clamp": base_pose(arm), "element": element_numbers(arm, scene, form, at.s, mesh.s)}
    if form.loaded:
        load = scene.find(TipLoad)
        wrench = [load.moment, load.force] if load else np.zeros((2, 3))
        columns["tip"] = np.concatenate([np.ravel(wrench), np.zeros(3)])
    if of.levers:
        columns["lever"] = levers(scene)[1].T
    if form.friction:
        columns |= friction_numbers(arm, scene, mesh, of, at)
    else:
        columns |= {"body": at.body, "tendon": at.paths}
    if form.contacts:
        columns |= contact_numbers(arm, scene, form, mesh)
    # Some kernels take no numbers.
    names = (term.kernel.name for term in of.equations.terms)
    p = np.concatenate([np.ravel(columns[name], "F") for name in names if name in columns])
    return p, np.vstack([at.paths, weights[at.place]]).ravel("F")


def contact_numbers(arm: Arm, scene: Scene, form: Form, mesh: Mesh) -> dict[str, Array]:
    """Return the numbers of the nodes and elements that may touch something; none does yet."""
    h, s = np.diff(mesh.s), mesh.s[1:]
    touched = contacts(scene)
    bodies = np.tile(bodies_of(scene).T, h.size)
    nodes = np.repeat([*arm.outer_radius(s)[:2], h], len(touched), axis=1)
    touching = np.vstack([bodies, nodes, np.zeros((4, bodies.shape[1]))])
    if form.contact_friction:
        mu = np.tile([contact.friction for contact in touched], h.size)
        # By the stiffness along the arm, E A / L, steps went from sticking to slip and back.
        r = _RESISTS * arm.bending_force / arm.length
        touching = np.vstack([touching, mu, np.full(mu.size, r), np.zeros((3, mu.size))])
    columns = {"touch": touching}
    if form.pressed:
        columns["pressure"] = np.vstack([bodies, nodes[2], 0 * nodes[2]])
    return columns


def friction_numbers(
    arm: Arm, scene: Scene, mesh: Mesh, of: Layout, at: Sections
) -> dict[str, Array]:
    """Return the numbers of bodies and their rates, of tendons that slide through elements (n, P).

    See TendonSymbols; and those (6, P) of the kinks of tendons that go on beyond anchorages.
    """
    m, h, (k, j) = of.form.stages, np.diff(mesh.s), of.passages
    bodies = np.vstack([at.body, body_numbers(arm, scene, at.stations, rates=True)])
    slides = [h[k], friction_coefficients(arm, scene)[j]]
    for stage in range(m):
        arguments = arm, at.stations, k * m + stage, j
        slides += [tendon_paths(*arguments), tendon_paths(*arguments, 1)[2:]]
    k, j = of.kinks
    ends = stations(arm, mesh.s[k + 1], mesh.active[k + 1])
    kinks = [h[k], h[k + 1], tendon_paths(arm, ends, np.arange(k.size), j)]
    return {"body_rates": bodies, "sliding_tendon": np.vstack(slides), "kink": np.vstack(kinks)}


def friction_coefficients(arm: Arm, scene: Scene) -> Array:
    """Return direction times coefficient of friction of each tendon (n_tendons,)."""
    friction = scene.find(Friction)
    assert friction is not None
    return np.asarray(friction.mu * np.array(directions(arm, friction)))


def element_numbers(arm: Arm, scene: Scene, form: Form, s: Array, nodes: Array) -> Array:
    """Return the numbers (n, N) of elements between nodes (N + 1,); see ElementSymbols.

    Their stages are at s (N stages,).
    """
    N, m = nodes.size - 1, form.stages

    def by_element(rows: Array) -> Array:
        """Return rows (n, N stages) as (stages n, N)."""
        return rows.reshape(-1, N, m).transpose(2, 0, 1).reshape(-1, N)

    rows, radius = [np.diff(nodes)[None, :]], arm.radius.evaluate(s, arm.length)[0]
    if form.loaded:
        rows += [np.zeros((6, N)), by_element(beyond(arm, scene, s, np.repeat(nodes[1:], m)))]
    current = scene.find(Current)
    if form.current and current:
        drag = by_element(current.density * current.coefficient * radius)
        rows += [drag, np.repeat(np.array(current.velocity)[:, None], N, axis=1)]
    if form.friction:
        rows.append(by_element(np.outer(specific_weight(arm, scene), np.pi * radius**2)))
    return np.vstack(rows)
