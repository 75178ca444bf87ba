"""What holds at the tip of a loaded arm, and across its anchorages and loads: SX expressions."""

from __future__ import annotations

import casadi as ca

from model.loaded.equations import LoadEquations, Section
from model.loaded.state import to_local
from model.loaded.tendon_rates import slip
from model.rotations import rotate


def jump(
    e: LoadEquations, x: ca.SX, outer: list[ca.SX], y: ca.SX, inner: list[ca.SX], probe: ca.SX
) -> ca.SX:
    """Return what vanishes across an anchorage or a load (n_x,).

    x, y are the states on the tip and the base side; `outer`, `inner` pull, data and numbers;
    `probe` (3,) a moment that acts there, or nothing. The moment is continuous but for it, the
    force is what lies beyond, and a tendon that goes on bends by the angle between its tangents.
    """
    pose, strain, force, tensions = e.split(x)
    inner_pose, inner_strain, inner_force, inner_tensions = e.split(y)
    moment = e.statics.wrench(strain, e.pulled(outer[0], tensions), outer[1])[:3]
    if e.form.probed:
        moment = moment + to_local(pose, probe)
    wrench = e.wrench(moment, e.force(y, inner[2]))
    at = (inner_strain, e.pulled(inner[0], inner_tensions), inner[1])
    rows = [inner_pose - pose, _balance(e, at, wrench), inner_force - force]
    if e.n_tension:
        rows.append(inner_tensions - tensions * slip(e, strain, inner_strain, outer[2], inner[2]))
    rows.append(e.lengths(y) - e.lengths(x))
    return ca.vertcat(*rows)


def tip(e: LoadEquations, y: ca.SX, inner: list[ca.SX], load: ca.SX, probe: ca.SX) -> ca.SX:
    """Return what vanishes at the tip, for its strains, force, and lengths that are states.

    `load` (6,) is the force and moment of the load at the tip [N, N m], in the base frame or the
    tip's; `probe` (3,) a further moment in the base frame, or nothing.
    """
    pose, strain, force, tensions = e.split(y)
    moment = load[3:] if e.form.follower else to_local(pose, load[3:])
    if e.form.probed:
        moment = moment + to_local(pose, probe)
    at = (strain, e.pulled(inner[0], tensions), inner[1])
    rows = [_balance(e, at, e.wrench(moment, e.force(y, inner[2])))]
    if e.n_force:
        known = rotate(pose[:4], load[:3]) if e.form.follower else ca.SX.zeros(3)
        rows.append(force - known)
    return ca.vertcat(*rows, e.lengths(y))


def _balance(e: LoadEquations, at: Section, wrench: ca.SX) -> ca.SX:
    """Return L less the wrench as strains: moments over E J, forces over E A."""
    EA, EJ = at[2][0], at[2][1]
    gap = e.statics.wrench(*at) - wrench
    return ca.vertcat(gap[:3] / EJ, gap[3:] / EA)
