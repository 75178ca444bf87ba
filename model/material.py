"""What an arm is made of."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from model.quantities import Modulus, Positive, unit
from model.units import warn_of_density, warn_of_modulus
from model.value import value


@value
class Material:
    """An isotropic elastic material; the default is the silicone of tables 2 and 4.

    Attributes
    ----------
    E : float
        Young's modulus [Pa].
    nu : float
        Poisson's ratio, in (-1, 0.5].
    density : float
        [kg/m3].
    """

    E: Modulus = 110e3
    nu: Annotated[float, Meta(gt=-1, le=0.5)] = 0.5
    density: Annotated[Positive, unit("kg/m3")] = 1080.0

    def __post_init__(self) -> None:
        warn_of_modulus("Material.E", self.E)
        warn_of_density("Material.density", self.density)

    @property
    def G(self) -> float:
        """Shear modulus E / (2 (1 + nu)) [Pa]."""
        return self.E / (2 * (1 + self.nu))
