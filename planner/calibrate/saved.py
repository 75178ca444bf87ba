"""Calibrations that are loaded from files: checked as if they were asked afresh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from model import Arm, InputError, Scene
from model.errors import FileError
from planner.fit.calibration import Calibration
from planner.fit.fitted import Start
from planner.fit.least_squares import LOSSES, Weights
from planner.fit.measured import Measured
from planner.fit.unknowns import Unknown
from planner.records.calibration import CalibrationRecord
from planner.records.values import value
from planner.scenes.mistakes import mistake


def load_calibration(path: str | Path) -> Calibration:
    """Return the calibration that `Calibration.save` or `octoplan calibrate --json` wrote.

    It is equal to the one that was saved; residuals, standard errors and outcome are worked out
    anew. Raises FileError for what cannot be read or is none.
    """
    name = str(path)
    record = _record(Path(path), name)
    asked, fit = record.question, record.fit
    try:
        arm, scene = (value(asked[key], name, f"question.{key}") for key in ("arm", "scene"))
        if not (isinstance(arm, Arm) and isinstance(scene, Scene) and fit.loss in LOSSES):
            raise FileError(name, "question", "no arm, no scene or no loss function")
        shapes = [Measured(**own).checked(arm, own["name"]) for own in asked["measured"]]
        unknowns = tuple(Unknown(**_tupled(own)) for own in asked["unknowns"])
        found = Calibration(
            arm,
            scene,
            tuple(shapes),
            unknowns,
            tuple(float(x) for x in fit.values),
            fit.noise,
            Weights(fit.loss, fit.absolute_std),  # type: ignore[arg-type]
            fit.refinement,
            fit.error,
            tuple(_start(own) for own in fit.starts),
            tuple(fit.astray),
            tuple((name, why) for name, why in fit.left_out),
            fit.stopped,
            stages=fit.stages,
        )
        if len(found.values) != len(unknowns) or not np.all(np.isfinite(found.values)):
            raise FileError(name, "fit.values", f"{len(unknowns)} finite numbers are needed")
        found.parameters  # noqa: B018  (checks keys and sessions)
    except InputError as reason:
        raise reason if isinstance(reason, FileError) else FileError.of(reason, name, "") from None
    except (TypeError, KeyError, AttributeError) as reason:
        raise FileError(name, "question", f"not what a calibration holds: {reason}") from None
    return found


def _record(path: Path, name: str) -> CalibrationRecord:
    try:
        table = msgspec.json.decode(path.read_bytes())
    except OSError as reason:
        told = (reason.strerror or str(reason)).lower()
        raise FileError(name, "", f"{told}; a calibration that was saved is wanted") from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as reason:
        raise FileError(name, "", f"this is not valid JSON: {reason}") from None
    try:
        return msgspec.convert(table, CalibrationRecord)
    except msgspec.ValidationError as reason:
        raise mistake(str(reason), name, table, CalibrationRecord) from None


def _tupled(table: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(own) if isinstance(own, list) else own for key, own in table.items()}


def _start(table: dict[str, Any]) -> Start:
    own = _tupled(table)
    return Start(own["values"], own["found"], float(own["misfit"]), own["why"])
