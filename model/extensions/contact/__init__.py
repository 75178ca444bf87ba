"""Contact of the arm with rigid obstacles and with itself."""

from octoplan.model.extensions.contact.effects import Contact, SelfContact

__all__ = ["Contact", "SelfContact"]
