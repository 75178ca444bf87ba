"""What an effect is: a frozen value that says which equations it changes."""

from __future__ import annotations

from typing import Any

from octoplan.model.support.checks import SUCH
from octoplan.model.support.value import value


@value
class Effect:
    """Base of all effects. An effect that is not in the scene leaves no trace in its equations."""

    @property
    def place(self) -> tuple[Any, ...]:
        """Where it acts: of kinds that say so a scene may have several, at different places."""
        return ()


SUCH[Effect] = "an effect such as Extension()"
