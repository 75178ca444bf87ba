"""Calibration and design: parameters of an arm, its scene and its sensors as unknowns."""
