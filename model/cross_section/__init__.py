"""Laws of a cross-section, one file each: strains to the wrench that body and tendons balance."""

from model.cross_section.choice import cross_section_of
from model.cross_section.law import CrossSection

__all__ = ["CrossSection", "cross_section_of"]
