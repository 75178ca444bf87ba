"""Plans for arms in contact: small programs in the tensions over settled shapes."""

from octoplan.planner.extensions.contact.hold import Hold
from octoplan.planner.extensions.contact.wrap import Wrap

__all__ = ["Hold", "Wrap"]
