"""Errors, checked values, text, progress and compiled functions, for all other modules."""
