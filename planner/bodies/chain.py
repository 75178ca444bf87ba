"""A chain of rigid links that follows a settled arm, for simulators of rigid bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from model.checks import within
from model.paths import Array
from model.scene import Scene
from model.settle import settle
from model.shape import Shape

MOST_LINKS = 1000
# Of the rest shape, over the arm's length.
_ACCURACY = 1e-9


@dataclass(frozen=True, eq=False)
class Chain:
    """N links between N + 1 nodes, evenly spaced on the midline at rest, and the tip's frame.

    Link i has its origin at node i and its x axis along the chord to the next; the last link, N, is
    the tip's frame, without extent. Link i + 1 hangs on link i by a slide along that chord and
    three hinges at its own origin, about its axes x, y, z in turn; link 0 on the base by hinges.

    Attributes
    ----------
    s : (N + 1,)
        Arc lengths of the nodes [m].
    chords : (N,)
        Distances of the nodes at rest [m].
    rest : (N + 1, 3, 3)
        Orientation of each link in the one before, at rest; of link 0 in the base frame.
    angles : (N + 1, 3)
        Of the hinges in the settled arm [rad].
    slides : (N,)
        Of the slides in the settled arm [m].
    radii, masses : (N,)
        Of the links [m], [kg].
    hinge_stiffness : (N + 1, 3)
        About x, y, z: G J_t / h, E J / h, E J / h [N m/rad].
    slide_stiffness : (N,)
        E A / h [N/m].
    passed : (n_tendons,)
        How many nodes each tendon passes.
    """

    s: Array
    chords: Array
    rest: Array
    angles: Array
    slides: Array
    radii: Array
    masses: Array
    hinge_stiffness: Array
    slide_stiffness: Array
    passed: NDArray[np.int64]

    @property
    def joints(self) -> dict[str, float]:
        """Positions of all joints in the settled arm [m], [rad], by name, from the base on."""
        moved = np.column_stack([np.append(0.0, self.slides), self.angles])
        names = [f"{kind}_{i}" for i in range(self.s.size) for kind in ("slide", "x", "y", "z")]
        # Link 0 hangs on the base by hinges alone.
        return dict(zip(names[1:], moved.ravel().tolist()[1:], strict=True))


def chain_of(shape: Shape, links: int) -> Chain:
    """Return the chain of so many links that follows a shape; InputError for none or too many."""
    within("links", links, 1, MOST_LINKS)
    arm = shape.arm
    s = np.linspace(0.0, arm.length, links + 1)
    at_rest = settle(arm, np.zeros(arm.n_tendons), Scene(), _ACCURACY)
    rest, chords = _relative(at_rest, s)
    now, lengths = _relative(shape, s)
    turned = Rotation.from_matrix(np.swapaxes(rest, 1, 2) @ now).as_euler("XYZ")
    h, radius = np.diff(s), arm.radius.evaluate(s, arm.length)[0]
    middle = arm.radius.evaluate((s[:-1] + s[1:]) / 2, arm.length)[0]
    masses = arm.material.density * np.pi * middle**2 * h
    # A hinge stands for half a link on either side.
    spans = (np.append(0.0, h) + np.append(h, 0.0)) / 2
    EJ, GJ = (k * np.pi * radius**4 / 4 for k in (arm.material.E, 2 * arm.material.G))
    hinges = np.stack([GJ, EJ, EJ], axis=1) / spans[:, None]
    slides = arm.material.E * np.pi * middle**2 / h
    ends = np.array([arm.sections[i].at for i, _ in arm.tendons])
    passed = np.searchsorted(s, ends * (1 + 1e-12), side="right")
    return Chain(s, chords, rest, turned, lengths - chords, middle, masses, hinges, slides, passed)


def _relative(shape: Shape, s: Array) -> tuple[Array, Array]:
    """Return the orientation of each link in the one before, and the distances of the nodes."""
    middle = (s[:-1] + s[1:]) / 2
    chords = np.diff(shape.position(s), axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    # By the least rotations that turn the x axes t along the chords: quaternions are scaled.
    frames, along = shape.frame(middle), chords / lengths[:, None]
    t = frames[:, :, 0]
    cosines = np.sum(t * along, axis=1)
    least = Rotation.from_quat(np.column_stack([np.cross(t, along), 1 + cosines]))
    frames = least.as_matrix() @ frames
    world = np.array([np.array(shape.arm.base_frame), *frames, shape.tip_frame])
    return np.swapaxes(world[:-1], 1, 2) @ world[1:], lengths
