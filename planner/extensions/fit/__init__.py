"""Numbers of an arm, its scene and its sensors as unknowns: calibration and design."""
