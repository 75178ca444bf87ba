"""Workspaces: samples that settle, then rounds of plans that classify the gaps between tips."""

from __future__ import annotations

import json
import logging
import re
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from octoplan.model.arm import Arm
from octoplan.model.forward import checked_accuracy
from octoplan.model.loads import check_responses, has_complementarity
from octoplan.model.paths import Array
from octoplan.model.scene import Scene
from octoplan.model.support.checks import flag, positive, whole
from octoplan.model.support.errors import InputError, OctoplanError, needed
from octoplan.model.support.machine.compiled import Compile, checked_compile
from octoplan.planner.frontends.io.codec import identity
from octoplan.planner.frontends.io.files import versions
from octoplan.planner.frontends.io.scene_file import scene_table
from octoplan.planner.frontends.sweeps.store import (
    attributes_in,
    check_store,
    folder_of,
    save,
    sequential_dask,
)
from octoplan.planner.frontends.sweeps.sweep import check_jobs, compute_chunks
from octoplan.planner.frontends.sweeps.work import Point, Rows
from octoplan.planner.frontends.workspaces.gaps import MARGIN, Classified, Region, regions_of
from octoplan.planner.frontends.workspaces.points import LABELS, VARIABLES, WorkspaceJob
from octoplan.planner.frontends.workspaces.sampling import sampled_tensions
from octoplan.planner.frontends.workspaces.verdicts import (
    KINDS,
    classified,
    doubtful,
    kinds_of,
    nearest_tensions,
    replace_plans,
    targets_of,
)
from octoplan.planner.limits import Limits, checked_limits
from octoplan.planner.planning_problem import planned_scene

_log = logging.getLogger("octoplan.planner.frontends.workspaces")
# Accuracy of shapes unless given: a tenth of a millimetre for an arm of 1 m [-].
ACCURACY = 1e-4
# Numbers of sampled tensions and of plans unless given.
SAMPLES = 500
PROBES = 400
# Number of rounds of probes: each round fills the gaps that the rounds before have left.
_ROUNDS = 5
# Share of the probes of a round in space; the others are in the slices [-].
_IN_SPACE = 0.3
# Number of points in a chunk: an interruption loses the chunks in progress.
_CHUNK = 8
_NUMBER = re.compile(r"-?\d[\d.]*(e[+-]?\d+)?")


@dataclass(frozen=True, eq=False)
class _Stage:
    """Points of one kind that are computed in chunks: samples, or a round of probes.

    Attributes
    ----------
    job : WorkspaceJob
    values : (m, n)
        One row for each point.
    wanted : str
        Hash of the whole workspace.
    """

    job: WorkspaceJob
    values: Array
    wanted: str

    @property
    def size(self) -> int:
        """Number of points."""
        return len(self.values)

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.size // _CHUNK)

    def points(self, chunk: int) -> list[Point]:
        """Return the points of a chunk."""
        some = self.values[chunk * _CHUNK : (chunk + 1) * _CHUNK]
        return [tuple(row) for row in some.tolist()]

    @cached_property
    def identity(self) -> str:
        """Hash of everything that determines the results."""
        return identity(self.wanted, self.values)


@dataclass(frozen=True, eq=False)
class Workspace:
    """The definition of a workspace.

    Attributes
    ----------
    job : WorkspaceJob
    samples, probes : int
        Numbers of sampled tensions and of plans.
    seed : int
    """

    job: WorkspaceJob
    samples: int
    probes: int
    seed: int

    @cached_property
    def identity(self) -> str:
        """Hash of everything that determines the results."""
        job = self.job
        limits = job.limits
        return identity(
            "workspace",
            list(VARIABLES),
            (job.arm, job.scene, limits.lower, limits.upper, limits.total),
            (job.accuracy, job.least_effort, job.compile, job.time_limit),
            (self.samples, self.probes, self.seed),
        )

    def computed(self, folder: Path, jobs: int, scheduler: str | None) -> Any:
        """Return the Dataset; finished chunks are files in a folder."""
        job = self.job
        folder.mkdir(exist_ok=True)

        def rows_of(name: str, stage: _Stage, phase: str) -> Rows:
            chunks = compute_chunks(stage, folder / name, jobs, scheduler, phase)
            names = VARIABLES if stage.chunks else ()
            return {
                each: np.concatenate([chunks.read(i, each) for i in range(stage.chunks)])
                for each in names
            }

        tensions = sampled_tensions(job.arm, job.limits, self.samples, self.seed)
        known = rows_of("samples", _Stage(job, tensions, self.identity), "samples settled")
        if not known["settled"].any():
            raise OctoplanError(
                f"none of {self.samples} sets of tensions has a stable shape, for example: "
                f"{known['outcome'][0]}"
            )
        regions = regions_of(job.arm, known["tip"][known["settled"]])
        prober = replace(job, is_probe=True)
        searched = np.zeros(0, int)
        for i in range(_ROUNDS + 1):
            again = np.setdiff1d(doubtful(known, job), searched)
            targets = self._targets(known, regions, i)
            points = np.vstack([targets, targets_of(known)[again]])
            in_full = np.arange(len(points)) >= len(targets)
            nearest = nearest_tensions(known, points)
            stage = _Stage(prober, np.column_stack([points, in_full, nearest]), self.identity)
            rows = rows_of(f"probes-{i}", stage, f"plans of round {i + 1} of {_ROUNDS + 1}")
            if rows:
                new = {name: each[: len(targets)] for name, each in rows.items()}
                better = {name: each[len(targets) :] for name, each in rows.items()}
                replace_plans(known, again, better, job)
                known = {name: np.concatenate([known[name], new[name]]) for name in known}
            searched = np.union1d(searched, again)
            tips = known["tip"][known["settled"]]
            regions = tuple(each.around(tips, MARGIN * job.arm.length) for each in regions)
        return self._dataset(known, regions)

    def _targets(self, known: Rows, regions: Sequence[Region], number: int) -> Array:
        """Return the new targets of a round (m, 3)."""
        if number == _ROUNDS:
            return np.zeros((0, 3))
        state = classified(known, self.job)
        total = self.probes * (number + 1) // _ROUNDS - self.probes * number // _ROUNDS
        targets = np.zeros((0, 3))
        for left, region in zip(range(len(regions), 0, -1), regions, strict=True):
            is_space = len(regions) > 1 and not region.is_plane
            share = _IN_SPACE if is_space else 1 / left
            count = round((total - len(targets)) * share)
            new = state.next_targets(region, count, self.seed + number)
            targets = np.vstack([targets, new])
        return targets

    def _dataset(self, known: Rows, regions: Sequence[Region]) -> Any:
        xarray = needed("xarray", "sweep")
        job = self.job
        state = classified(known, job)
        kinds = kinds_of(known, job)
        rows = {**known, "outcome": known["outcome"].astype(str)}
        variables = dict[str, Any]()
        for name, item in VARIABLES.items():
            units = {"units": item.units} if item.units else {}
            labels = {**units, "long_name": item.about}
            variables[name] = (("point", *item.dims), rows[name], labels)
        planes = [region for region in regions if region.is_plane]
        k = 2 if len(regions) == 1 else 3
        gain = known["tip_gain"][:, :k]
        with np.errstate(invalid="ignore", divide="ignore"):
            dexterity = gain[:, -1] / gain[:, 0]
        empty = np.full(len(kinds), np.nan)
        empty[kinds == KINDS.index("boundary")] = state.radii
        for name, values, unit, text in (
            ("dexterity", dexterity, "1", "smallest over largest singular value of the tip"),
            ("manipulability", gain.prod(axis=1), f"(m/N)^{k}", "product of the singular values"),
            ("empty_radius", empty, "m", "radius of the ball around the target without tips"),
        ):
            variables[name] = ("point", values, {"units": unit, "long_name": text})
        about = "sample, probe (tip of a plan), boundary (nearest tip to a target) or refused"
        variables["kind"] = ("point", np.array(KINDS)[kinds], {"long_name": about})
        for name, value, dims in (
            ("slice_origin", [region.origin for region in planes], ("xyz",)),
            ("slice_axes", [region.axes for region in planes], ("slice_axis", "xyz")),
            ("slice_low", [region.low for region in planes], ("slice_axis",)),
            ("slice_high", [region.high for region in planes], ("slice_axis",)),
        ):
            variables[name] = (("slice", *dims), np.array(value))
        coords = {
            **LABELS,
            "tendon": list(job.arm.tendon_names),
            "slice": [region.name for region in planes],
        }
        return xarray.Dataset(variables, coords, self._attributes(known, kinds, state, regions))

    def _attributes(
        self, known: Rows, kinds: NDArray[Any], state: Classified, regions: Sequence[Region]
    ) -> dict[str, Any]:
        """Return the attributes of the Dataset: counts, failures, gaps, versions and scene."""
        failures: dict[str, tuple[str, int]] = {}
        for text in known["outcome"][~known["settled"]].tolist():
            example, count = failures.get(sort := _NUMBER.sub("#", text), (text, 0))
            failures[sort] = (example, count + 1)
        table = scene_table(self.job.arm, self.job.scene)
        return {
            "title": "octoplan workspace",
            "identity": self.identity,
            "planar": int(len(regions) == 1),
            **{KINDS[i]: int((kinds == i).sum()) for i in range(len(KINDS))},
            "failures": json.dumps(dict(sorted(failures.values(), key=lambda item: -item[1]))),
            "largest_gap_m": state.largest_gap(regions[0], self.seed),
            "tension_min_N": list(self.job.limits.lower),
            "tension_max_N": list(self.job.limits.upper),
            "accuracy": self.job.accuracy,
            "least_effort": int(self.job.least_effort),
            "scene": msgspec.json.encode(table).decode(),
            **{f"{name}_version": number for name, number in versions().items()},
        }


def workspace_of(
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
    time_limit: float | None = None,
    compile: Compile = False,  # noqa: A002  (the name that scripts use)
) -> Workspace:
    """Return the definition of a workspace; see `workspace`. Raises InputError."""
    scene = planned_scene(arm, scene)
    check_responses(scene)
    if has_complementarity(scene):
        raise InputError("scene", scene, "a scene without contact and self-contact")
    bounds = checked_limits(arm, scene, tension_max, limits)
    if not np.isfinite(bounds.upper).all():
        raise InputError("tension_max", bounds.upper, "finite numbers")
    if bounds.strokes is not None:
        allowed = "omitted: a workspace has limits of tensions alone"
        raise InputError("limits.stroke_max, limits.stroke_min", bounds.strokes, allowed)
    samples = whole("samples", samples, 1)
    probes = whole("probes", probes, 0)
    seed = whole("seed", seed, 0)
    least_effort = flag("least_effort", least_effort)
    job = WorkspaceJob(
        arm,
        scene,
        bounds,
        checked_accuracy(accuracy),
        least_effort,
        checked_compile(compile),
        None if time_limit is None else positive("time_limit", time_limit),
    )
    return Workspace(job, samples, probes, seed)


def write_workspace(
    wanted: Workspace, path: Path, *, jobs: int = 1, scheduler: str | None = None
) -> bool:
    """Write the Dataset of a workspace; return whether the file existed already."""
    check_jobs(jobs)
    check_store(path)
    is_earlier = attributes_in(path).get("identity") == wanted.identity
    if not is_earlier:
        data = wanted.computed(folder_of(path), jobs, scheduler)
        with sequential_dask():
            save(data, path)
    shutil.rmtree(folder_of(path), ignore_errors=True)
    return is_earlier
