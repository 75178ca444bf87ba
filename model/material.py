"""What an arm is made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from model.checks import positive, within
from model.errors import InputError
from model.quantities import Modulus, Positive, unit
from model.units import warn_of_density, warn_of_modulus


@dataclass(frozen=True)
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
        if within("Material.nu", self.nu, -1.0, 0.5) == -1.0:
            raise InputError("Material.nu", self.nu, "a number above -1, up to 0.5")
        object.__setattr__(self, "E", positive("Material.E", self.E))
        warn_of_modulus("Material.E", self.E)
        object.__setattr__(self, "nu", float(self.nu))
        object.__setattr__(self, "density", positive("Material.density", self.density))
        warn_of_density("Material.density", self.density)

    @property
    def G(self) -> float:
        """Shear modulus E / (2 (1 + nu)) [Pa]."""
        return self.E / (2 * (1 + self.nu))
