"""What an effect is: a frozen value that says which equations it changes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Effect:
    """Base of all effects. An effect that is not in the scene leaves no trace in its equations."""
