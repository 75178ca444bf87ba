"""Joints that move the base of an arm: unknowns of plans and motions."""
