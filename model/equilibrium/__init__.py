"""Equilibria of the transcribed arm: Newton's method, load stepping, stability, sensitivities."""
