"""Options of the nonlinear program: everything but arm, scene, targets and limits."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta

from octoplan.model.forward import FINEST
from octoplan.model.paths import Array

Norm = Literal["2", "1", "inf"]
Mode = Literal["exact", "closest", "nearest"]


@dataclass(frozen=True)
class NlpOptions:
    """Options of the nonlinear program.

    Attributes
    ----------
    norm : "2", "1" or "inf"
        Norm of the tensions that is minimised.
    mode : "exact", "closest" or "nearest"
        Treatment of the targets; see octoplan.planner.program. The search chooses the mode.
    refinement : int
        Refinement of the mesh. An element has three Gauss stages. The search chooses the mesh.
    margin : float
        Smallest accepted stability; see octoplan.planner.certificate.
    modes : 0 or 1
        Number of least stable modes that the program constrains. With 0, stability is only checked.
    floor : float
        Smallest stability for constrained modes. An arm that is about to yield does not settle.
    """

    norm: Norm = "2"
    mode: Mode = "exact"
    refinement: Annotated[int, Meta(ge=1, le=FINEST)] = 4
    margin: float = 0.0
    modes: Annotated[int, Meta(ge=0, le=1)] = 0
    floor: float = 1e-2

    @property
    def stability_bound(self) -> float:
        """The lower bound of the stability of constrained modes."""
        return max(self.margin, self.floor)

    def replace(self, **changes: Any) -> NlpOptions:
        """Return the options with some values replaced."""
        return dataclasses.replace(self, **changes)


def effort(tensions: Array, norm: Norm) -> Array:
    """Return the norms (...) of tensions (..., n_tendons) [N]."""
    return np.asarray(np.linalg.norm(tensions, float(norm), axis=-1))
