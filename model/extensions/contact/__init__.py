"""Equilibria of an arm in contact with rigid obstacles."""
