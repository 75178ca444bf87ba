"""Errors, values, checks, text, progress and compiled functions, on which all modules rest."""
