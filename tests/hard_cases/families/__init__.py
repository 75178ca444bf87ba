"""The families of hard cases, a file each."""

from tests.hard_cases.families import (
    any_tension,
    compression,
    layouts,
    many_turns,
    slender_tips,
)

FAMILIES = (
    slender_tips.FAMILY,
    *any_tension.FAMILIES,
    many_turns.FAMILY,
    *compression.FAMILIES,
    layouts.FAMILY,
)
