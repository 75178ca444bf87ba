"""Calibration: numbers of an arm and its scene from measured shapes."""
