"""Values of the nodes in between them: on the cubic through the four nodes around."""

from __future__ import annotations

import numpy as np

from model.paths import Array


def between_nodes(nodes: Array, values: Array, s: Array) -> Array:
    """Return values (k, ...) at arc lengths s (k,) of those (N, ...) at nodes (N,), N >= 4."""
    first = np.clip(np.searchsorted(nodes, s) - 2, 0, nodes.size - 4)
    around = first[:, None] + np.arange(4)
    return np.asarray(np.einsum("km,km...->k...", _weights(nodes[around], s), values[around]))


def _weights(nodes: Array, s: Array) -> Array:
    """Return how values at nodes (k, m) weigh in those of their polynomials at s (k,)."""
    same = np.eye(nodes.shape[1])
    apart = nodes[:, :, None] - nodes[:, None, :] + same
    shares = (s[:, None] - nodes)[:, None, :] / apart
    return np.asarray(np.where(same > 0, 1.0, shares).prod(axis=2))
