"""Verdicts on the points of a workspace: kinds, doubtful plans, tips and empty balls."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from octoplan.model.paths import Array
from octoplan.planner.frontends.sweeps.work import Rows
from octoplan.planner.frontends.workspaces.gaps import Classified, is_in_hull
from octoplan.planner.frontends.workspaces.points import REACHED, WorkspaceJob
from octoplan.planner.solution import KKT_TOLERANCE

# Effort over the median of tips nearby above which a plan is searched again in full [-], and the
# number of tips nearby. The effort of local optima is often twice as large.
_DEAR = 1.2
_NEARBY = 6
KINDS = ("sample", "probe", "boundary", "refused")
"""Kinds of points: a settled sample; a tip of a plan; a tip of a plan that is nearest to a target
out of reach; a point without a stable shape."""


def misses(known: Rows) -> Array:
    """Return the distances (m,) of tips from targets [m]; nan for samples and failures."""
    return np.asarray(np.linalg.norm(known["tip"] - known["target"], axis=1))


def least_distances(known: Rows) -> Array:
    """Return the distances (m,) of targets from the nearest known tip [m]; nan without a target."""
    tree = KDTree(known["tip"][known["settled"]])
    distances = np.full(len(known["tip"]), np.nan)
    probes = np.isfinite(known["target"][:, 0])
    if probes.any():
        distances[probes] = tree.query(known["target"][probes])[0]
    return distances


def nearest_tensions(known: Rows, points: Array) -> Array:
    """Return the tensions (m, n_tendons) of the tips nearest to points (m, 3) [N]."""
    settled = known["settled"]
    _, nearest = KDTree(known["tip"][settled]).query(points.reshape(-1, 3))
    return np.asarray(known["tensions"][settled][nearest])


def targets_of(known: Rows) -> Array:
    """Return the targets of plans, and the tips of samples (m, 3) [m]."""
    is_probe = np.isfinite(known["target"][:, :1])
    return np.where(is_probe, known["target"], known["tip"])


def doubtful(known: Rows, job: WorkspaceJob) -> NDArray[np.int_]:
    """Return the indices of plans whose search found another local optimum than the best.

    Such a plan is no local optimum, or farther from the target than a known tip; its target is out
    of reach though between known tips; or its effort exceeds that of tips nearby.
    """
    tolerance = REACHED * job.accuracy * job.arm.length
    gaps = misses(known)
    is_missed = gaps > tolerance
    is_farther = gaps > least_distances(known) + tolerance
    result = is_farther | (is_missed & ~(known["optimality"] <= KKT_TOLERANCE))
    settled = np.flatnonzero(known["settled"])
    missed = np.flatnonzero(is_missed)
    is_between = is_in_hull(known["target"][missed], known["tip"][settled])
    result[missed[is_between]] = True
    if len(settled) > _NEARBY and job.least_effort:
        tips = known["tip"][settled]
        effort = known["effort"][settled]
        _, nearby = KDTree(tips).query(tips, _NEARBY + 1)
        usual = np.median(effort[nearby[:, 1:]], axis=1)
        is_dear = (effort > _DEAR * usual) & ~is_missed[settled]
        result[settled[is_dear]] = True
    return np.flatnonzero(result)


def replace_plans(known: Rows, which: NDArray[np.int_], rows: Rows, job: WorkspaceJob) -> None:
    """Replace plans by those of a full search, if nearer to the target or of less effort."""
    tolerance = REACHED * job.accuracy * job.arm.length
    before = np.linalg.norm(known["tip"] - targets_of(known), axis=1)[which]
    after = misses(rows)
    is_nearer = after < before - tolerance
    is_cheaper = (after <= before + tolerance) & (rows["effort"] < known["effort"][which])
    was_optimal = (before <= tolerance) | (known["optimality"][which] <= KKT_TOLERANCE)
    is_optimal = (after <= before + tolerance) & ~was_optimal
    is_better = rows["settled"] & (is_nearer | is_cheaper | is_optimal)
    for name in known:
        if name != "target":
            known[name][which[is_better]] = rows[name][is_better]


def kinds_of(known: Rows, job: WorkspaceJob) -> NDArray[Any]:
    """Return the index in KINDS of each point."""
    tolerance = REACHED * job.accuracy * job.arm.length
    gaps = misses(known)
    is_probe = np.isfinite(known["target"][:, 0])
    is_nearest = (gaps > tolerance) & (gaps <= least_distances(known) + tolerance)
    is_boundary = is_nearest & (known["optimality"] <= KKT_TOLERANCE)
    kinds = np.where(is_probe, KINDS.index("probe"), KINDS.index("sample"))
    kinds[is_boundary] = KINDS.index("boundary")
    kinds[~known["settled"]] = KINDS.index("refused")
    return kinds


def classified(known: Rows, job: WorkspaceJob) -> Classified:
    """Return the known tips, and the balls around the targets of boundary points."""
    is_boundary = kinds_of(known, job) == KINDS.index("boundary")
    return Classified(
        known["tip"][known["settled"]],
        known["target"][is_boundary],
        least_distances(known)[is_boundary],
    )
