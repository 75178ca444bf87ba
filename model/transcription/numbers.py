"""The numbers that the kernels take of an arm and a scene on a mesh."""

from __future__ import annotations

import numpy as np

from model.arm import Arm
from model.cross_section.sections import body_numbers
from model.effects import Current, Friction, TipLoad
from model.loads import beyond, contacts, directions, heaviness, levers
from model.mesh import Mesh
from model.obstacles import numbers_of
from model.paths import Array
from model.scene import Scene
from model.stations import (
    Stations,
    base_pose,
    stations,
    tendon_path_rates,
    tendon_paths,
)
from model.transcription.element import Form
from model.transcription.layout import Layout
from model.transcription.touch import BEFORE, FRICTION_TOLD, TOLD

# What slip is weighted with in contact friction, over the stiffness E J / L^3 of the base.
_RESISTS = 10.0


def numbers(arm: Arm, scene: Scene, mesh: Mesh, of: Layout) -> tuple[Array, Array, Array]:
    """Return the numbers of an arm and a scene in the order of the layout's terms.

    Those of the equations of equilibrium (n_p,), of the equations of the tendons' lengths (n,), and
    the arc lengths of the stages (N stages,) [m].
    """
    form, (stage, number) = of.form, of.crossings
    s, weights, active = mesh.points(form.stages)
    at = stations(arm, s, active)
    paths = tendon_paths(arm, at, stage, number)
    columns = [base_pose(arm), element_numbers(arm, scene, form, s, mesh.s)]
    if form.loaded:
        load = scene.find(TipLoad)
        wrench = [load.moment, load.force] if load else np.zeros((2, 3))
        columns.append(np.concatenate([np.ravel(wrench), np.zeros(3)]))
    if of.levers:
        columns.append(levers(scene)[1].T)
    body = body_numbers(arm, scene, at)
    if form.friction:
        columns.append(np.vstack([body, body_numbers(arm, scene, at, rates=True)]))
        columns += friction_numbers(arm, scene, mesh, of, at)
    else:
        columns += [body, paths]
    if form.contacts:
        columns += contact_numbers(arm, scene, form, mesh)
    p = np.concatenate([np.ravel(column, "F") for column in columns])
    return p, np.vstack([paths, weights[stage]]).ravel("F"), s


def contact_numbers(arm: Arm, scene: Scene, form: Form, mesh: Mesh) -> list[Array]:
    """Return the numbers of the nodes and elements that may touch something; none does yet."""
    h, s = np.diff(mesh.s), mesh.s[1:]
    bodies = numbers_of([contact.obstacle for contact in contacts(scene)]).T
    K = bodies.shape[1]
    values = np.zeros((TOLD, h.size * K))
    nodes = np.vstack([np.repeat(row, K) for row in (*arm.outer_radius(s)[:2], h)])
    results = [np.vstack([np.tile(bodies, h.size), nodes, values])]
    if form.pressed:
        results.append(np.vstack([np.tile(bodies, h.size), np.repeat(h, K), np.zeros(h.size * K)]))
    if form.contact_friction:
        mu = [contact.friction for contact in contacts(scene)]
        radius = float(arm.outer_radius(np.zeros(1))[0][0])
        # By the stiffness along the arm, E A / L, steps went from sticking to slip and back.
        r = _RESISTS * arm.material.E * np.pi * radius**4 / 4 / arm.length**3
        by_length = np.repeat(r / h, K)
        scales = np.vstack([np.tile(mu, h.size), np.full(h.size * K, r), by_length])
        results.append(
            np.vstack(
                [np.tile(bodies, h.size), scales, np.zeros((FRICTION_TOLD + BEFORE, h.size * K))]
            )
        )
    return results


def friction_numbers(arm: Arm, scene: Scene, mesh: Mesh, of: Layout, at: Stations) -> list[Array]:
    """Return the numbers (n, P) of tendons that slide through elements; see TendonSymbols.

    And those (6, P) of the kinks of tendons that go on beyond anchorages.
    """
    m, h, (k, j) = of.form.stages, np.diff(mesh.s), of.passages
    slides = [h[k], friction_coefficients(arm, scene)[j]]
    for stage in range(m):
        arguments = arm, at, k * m + stage, j
        slides += [tendon_paths(*arguments), tendon_path_rates(*arguments)[2:]]
    k, j = of.kinks
    ends = stations(arm, mesh.s[k + 1], mesh.active[k + 1])
    kinks = [h[k], h[k + 1], tendon_paths(arm, ends, np.arange(k.size), j)]
    return [np.vstack(slides), np.vstack(kinks)]


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
    rows = [np.diff(nodes)[None, :]]
    if form.loaded:
        dead = beyond(arm, scene, s, np.repeat(nodes[1:], m))
        rows += [np.zeros((6, N)), dead.reshape(3, N, m).transpose(2, 0, 1).reshape(-1, N)]
    current = scene.find(Current)
    if form.current and current:
        R = arm.radius.evaluate(s, arm.length)[0]
        drag = current.density * current.coefficient * R
        rows += [drag.reshape(N, m).T, np.repeat(np.array(current.velocity)[:, None], N, axis=1)]
    if form.friction:
        area = np.pi * arm.radius.evaluate(s, arm.length)[0] ** 2
        spread = np.outer(heaviness(arm, scene), area)
        rows.append(spread.reshape(3, N, m).transpose(2, 0, 1).reshape(-1, N))
    return np.vstack(rows)
