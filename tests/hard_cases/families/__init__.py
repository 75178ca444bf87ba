"""The families of hard cases, a file each."""

from tests.hard_cases.families import (
    any_tension,
    compression,
    exact_values,
    heavy_loads,
    ill_posed_plans,
    layouts,
    many_turns,
    slender_tips,
    stiff_friction,
    turned_scenes,
    units,
)

FAMILIES = (
    slender_tips.FAMILY,
    *any_tension.FAMILIES,
    many_turns.FAMILY,
    *compression.FAMILIES,
    layouts.FAMILY,
    exact_values.FAMILY,
    units.FAMILY,
    turned_scenes.FAMILY,
    heavy_loads.FAMILY,
    stiff_friction.FAMILY,
    ill_posed_plans.FAMILY,
)
