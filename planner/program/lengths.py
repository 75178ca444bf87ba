"""The lengths of the tendons as unknowns of a program: for limits of strokes and their rates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from model.paths import Array
from model.transcription.equations import Term
from model.transcription.kernels import Places
from model.transcription.layout import Layout
from model.transcription.system import System
from planner.program.blocks import scaled


@dataclass(frozen=True)
class TendonLengths:
    """The lengths of the tendons, counted in the arm's; see planner.program.blocks."""

    of: Layout

    is_linear = True

    @property
    def size(self) -> int:
        """See Block.size."""
        return self.of.n_tendons

    def terms(self, place: Places, start: int, row: int) -> list[Term]:
        """See Block.terms."""
        (runs,) = self.of.lengths.terms
        each = np.arange(self.size)[None, :]
        path = Term(runs.kernel, place[runs.unknowns], row + runs.rows)
        return [path, Term(scaled(), start + each, row + each)]

    def numbers(self, at: System, along: Array) -> list[Array]:
        """See Block.numbers."""
        return [at.length_numbers.reshape(-1, 5).T, np.full((1, self.size), -1.0)]

    def scales(self, at: System) -> tuple[Array, Array]:
        """See Block.scales."""
        length = np.full(self.size, at.arm.length)
        return length, length
