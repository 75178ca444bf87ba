"""The tips that an arm reaches within tension limits, as an xarray Dataset."""

from __future__ import annotations

import logging
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from octoplan.model.arm import Arm
from octoplan.model.scene import Scene
from octoplan.model.support.machine.compiled import Compile
from octoplan.model.support.progress import with_progress
from octoplan.planner.frontends.io.files import path_of
from octoplan.planner.frontends.sweeps.store import open_dataset
from octoplan.planner.frontends.sweeps.sweep import check_jobs
from octoplan.planner.frontends.workspaces.definition import (
    ACCURACY,
    PROBES,
    SAMPLES,
    workspace_of,
    write_workspace,
)
from octoplan.planner.limits import Limits

_log = logging.getLogger("octoplan.planner.frontends.workspaces")


@with_progress
def workspace(
    arm: Arm,
    scene: Scene | None = None,
    tension_max: Any = np.inf,
    *,
    limits: Limits | None = None,
    samples: int = SAMPLES,
    probes: int = PROBES,
    least_effort: bool = True,
    accuracy: float = ACCURACY,
    seed: int = 0,
    out: str | Path | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    time_limit: float | None = None,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
    progress: bool | None = None,
) -> Any:
    """Return the tips that an arm reaches within tension limits, as an xarray Dataset.

    Samples are tensions over the box of limits and its faces, which settle. Plans then probe the
    largest gaps between tips: a plan either reaches the target, and the tip fills the gap; or it
    ends at the nearest tip found, which counts as a point of the boundary, and the ball around the
    target is empty. Plans that contradict other tips are searched again in full. Further rounds
    probe the gaps that are left. Plans are local optima, so that the boundary may omit tips that
    neither samples nor plans find. Obstacles and contact of the arm with itself are ignored.

    Results do not depend on the number of workers or on interruptions; see `sweep`. An interrupted
    workspace with `out` computes the missing chunks when started again.

    Parameters
    ----------
    arm, scene
        See settle. Scenes with contact are refused.
    tension_max, limits
        See plan. Largest tensions are finite, and strokes have no limits.
    samples : int
        Number of tension sets, of a low-discrepancy sequence.
    probes : int
        Number of plans that probe gaps: 30 % in space and 70 % in three slices. The tips of a
        planar arm are in one plane, and all plans are in this plane.
    least_effort : bool
        Whether to plan the least effort for the tip of each sample. The tip stays, and tensions,
        effort, stiffness and dexterity are those of the plan. With False all values are those of
        the sampled tensions, which are not the least for the tip.
    accuracy : float
        Tip error over arm length, and relative error of stiffness and dexterity.
    seed : int
        Seed of the tension sets.
    out : path
        File of the Dataset, .nc or .zarr. By default, an interruption loses all results.
    jobs, scheduler
        See sweep.
    time_limit : float
        Limit for each point [s]. A plan that reaches the limit is no boundary point.
    compile : bool or "auto"
        See settle.
    progress : bool
        See sweep.

    Returns
    -------
    xarray.Dataset
        All variables but the slices have the dimension `point`: samples, then probes. `kind` is
        "sample", "probe" (the tip of a plan), "boundary" (the nearest tip to a target out of reach,
        by first-order conditions and by all known tips) or "refused" (without a stable shape;
        `outcome` has the reason). `target` [m] is the target of a probe; `empty_radius` [m] is the
        radius of the empty ball around the target. `tip` (point, 3) [m], `tip_frame` (point, 3, 3)
        with columns t, n, b, and `tensions` (point, n_tendons) [N] describe the shape. `effort` [N]
        is the norm of the tensions: the least norm for the tip that was found, also on the
        boundary. `stiffness_min` and `stiffness_max` [N/m] are the stiffnesses along the softest
        and the stiffest direction at constant tensions. `tip_gain` (point, 3) [m/N] are the
        singular values of the derivative of the tip position by the tensions that can change.
        `manipulability` is their product [Yoshikawa1985], and `dexterity` the smallest over the
        largest [Salisbury1982], 0 if the tip cannot move in some direction; both use the two
        largest values for planar arms. Active limits of the tensions are ignored. Attributes:
        numbers of points of each kind, the reasons of refusals (`failures`), and `largest_gap_m`,
        the radius of the largest ball without tips that no plan found empty.

    Raises
    ------
    InputError
        If an argument is not allowed, or if OUT.chunks contains chunks of another workspace.
    OctoplanError
        If no sample has a stable shape.
    CompilerError
        If `compile` is True and no compiler works.
    MissingExtraError, WorkersLostError, VersionsError, FullDiskError
        See sweep.

    Sources: Yoshikawa, "Manipulability of robotic mechanisms", Int. J. Robotics Research 4 (1985);
    Salisbury, Craig, "Articulated hands: force control and kinematic issues", Int. J. Robotics
    Research 1 (1982).
    """
    wanted = workspace_of(
        arm,
        scene,
        tension_max,
        limits=limits,
        samples=samples,
        probes=probes,
        least_effort=least_effort,
        accuracy=accuracy,
        seed=seed,
        time_limit=time_limit,
        compile=compile,
    )
    if out is not None:
        path = path_of(out, "out")
        if write_workspace(wanted, path, jobs=jobs, scheduler=scheduler):
            _log.info("%s contains this workspace already; nothing is computed", path)
        return open_dataset(path)
    check_jobs(jobs)
    with TemporaryDirectory() as name:
        return wanted.computed(Path(name) / "chunks", jobs, scheduler)
