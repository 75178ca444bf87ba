"""Stiffness of single cross-sections of a settled shape."""

from __future__ import annotations

import numpy as np

from model.cross_section import cross_section_of
from model.cross_section.reported import strains_of
from model.cross_section.sections import Sections
from model.paths import Array
from model.shape import Shape


def section_stiffness(shape: Shape, s: Array) -> Array:
    """Return torsional, flexural about n and b, and axial stiffness (N, 4) at s (N,).

    The diagonal of d(wrench) / d(strain), tensions held: moments per curvature [N m2], force per
    stretch [N]; infinite without extension. Curvature is per unit deformed length with the paper's
    tangent, per unit reference length with exact tendons. At an anchorage, those on its base side.
    """
    law = cross_section_of(shape.scene)
    active = np.array([sum(section.at >= place for section in shape.arm.sections) for place in s])
    sections = Sections(shape.arm, shape.scene, law, s, active)
    v = strains_of(law, shape.strains(s))
    _, slopes = sections.wrench(v, sections.pulls(shape.tensions))
    diagonal = np.einsum("nii->ni", slopes)
    axial = diagonal[:, 3:4] if law.extension else np.full((s.size, 1), np.inf)
    return np.hstack([diagonal[:, :3], axial])
